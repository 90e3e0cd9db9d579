"""The world: a batch of parallel episodes, advanced tick by tick, refilled from a queue as episodes end."""

import itertools
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import engine, handover
from vpsci_ros.world.compiled import in_threads
from vpsci_ros.world.config import WorldConfig
from vpsci_ros.world.events import NO_EVENTS, list_events
from vpsci_ros.world.recording import NO_RECORDINGS, Recorded
from vpsci_ros.world.scenario import Scenario
from vpsci_ros.world.spawn import spawn_all
from vpsci_ros.world.state import EPISODE, IDLE, STARTED
from vpsci_ros.world.tables import Answers, settings_from, tables_from

Floats = NDArray[np.float64]
_NO_VALUES = np.empty(0)
_NO_ACTIONS, _NO_CONTROLS = np.empty((0, 2)), np.empty((0, 3))


class World:
    """`batch` parallel episodes of one vehicle and one pedestrian each, in lock-step.

    An episode is a pure function of (seed, scenario, number) and of the answers it gets: its bits do not depend on
    the batch, on its slot or on the other episodes. Fresh episodes enter at policy ticks only, so that all slots have
    their policy frames at the same ticks. The last frame of an episode is shown for one tick, with status ENDED.

    :param episodes: (scenario number, episode number) in the order in which slots take them; read as slots get free,
        so it may be an endless iterator.
    :param recorded: motion of the agents whose driver is "replay".
    :raises InvalidInput: no scenario, two with one number, a batch below 1, an episode whose scenario is not given or
        which has no recording though one is needed.
    """

    def __init__(
        self,
        config: WorldConfig,
        scenarios: Sequence[Scenario],
        episodes: Iterable[tuple[int, int]],
        batch: int,
        seed: int,
        recorded: Recorded | None = None,
    ) -> None:
        if batch < 1:
            raise InvalidInput(f"batch must be at least 1, got {batch}")
        if not 0 <= seed < 2**64:
            raise InvalidInput(f"seed must be from 0 to 2^64 - 1, got {seed}")
        self._rows = {scenario.number: row for row, scenario in enumerate(scenarios)}
        if len(self._rows) < max(1, len(scenarios)):
            raise InvalidInput(f"expected scenarios with different numbers, got {[s.number for s in scenarios]}")
        self.config = config
        self.scenarios = tuple(scenarios)
        self.seed = seed
        self.tick = 0
        self.state: NDArray[np.void] = np.zeros(batch, EPISODE)
        if "replay" in (config.vehicle_driver, config.pedestrian_driver) and recorded is None:
            raise InvalidInput(
                "a replay driver needs recordings: World(..., recorded=...), or the node's parameter recorded_bag"
            )
        self._recorded = recorded
        self._recordings = NO_RECORDINGS if recorded is None else recorded.arrays
        self._asks = "policy" in (config.vehicle_driver, config.pedestrian_driver)
        self._settings = settings_from(config)
        self._tables = tables_from(scenarios)
        self._queue: Iterator[tuple[int, int]] = iter(episodes)
        self._exhausted = False
        self._bits = np.zeros(batch, np.uint16)
        self._idle = batch
        self._ended: NDArray[np.int64] = np.empty(0, np.int64)
        self._started = self._fill()

    @property
    def done(self) -> bool:
        """Whether every episode of the queue has ended and every slot is idle."""
        return self._exhausted and self._idle == len(self.state)

    def take_started(self) -> NDArray[np.void]:
        """Return the STARTED events of tick 0, EVENT[n]."""
        return self._started

    def advance(
        self,
        curvttc: Floats | None,
        critical: NDArray[np.bool_] | NDArray[np.uint8] | None,
        vehicle_action: Floats | None = None,
        pedestrian_action: Floats | None = None,
        *,
        vehicle_control: Floats | None = None,
    ) -> NDArray[np.void]:
        """Move from `tick` to the next one with the answers to `tick`, and return what happened, EVENT[n].

        Policies' actions are used where `handover.acting` holds, and then held until the next policy frame; an
        external driver's are used at once, everywhere. Missing answers (None): without CurvTTC nothing counts as
        critical at this tick; without an action the rule-based driver acts until the next one.

        :param curvttc: float64[B] [s], infinity where there is none.
        :param critical: bool[B] or uint8[B].
        :param vehicle_action, pedestrian_action: float[B, 2] (longitudinal, lateral) [m/s2], in the heading frame of
            the vehicle at `tick`.
        :param vehicle_control: float[B, 3] (steer -1..1 positive to the left, throttle 0..1, brake 0..1), for the
            external driver, and preferred to `vehicle_action`.
        :raises InvalidInput: a wrong shape, or numbers that are not finite (NaN in `curvttc`).
        """
        answers = self._answers(curvttc, critical, vehicle_action, pedestrian_action, vehicle_control)
        engine.decide(self.state, answers, self._settings, self._bits)
        decided = list_events(self.state, self._bits)
        if len(self._ended):
            self.state[self._ended] = 0
            self._idle += len(self._ended)
        in_threads(lambda part: self._move(answers, part), len(self.state))
        self.tick += 1
        self._ended = np.flatnonzero(self._bits)
        arrived = list_events(self.state, self._bits)
        happened = [events for events in (decided, arrived, self._fill()) if len(events)]
        return np.concatenate(happened) if happened else NO_EVENTS

    def _move(self, answers: Answers, part: slice) -> None:
        own = Answers(*(array[part] for array in answers))  # type: ignore[arg-type]  # length 0 stays 0
        engine.move(self.state[part], own, self._tables, self._recordings, self._settings, self._bits[part])

    def place(
        self, slots: Sequence[int], episodes: Sequence[tuple[int, int]], seeds: Sequence[int] | None = None
    ) -> NDArray[np.void]:
        """Start these episodes in these slots now, whatever ran there, and return their STARTED events, EVENT[n].

        For environments that decide themselves when an episode is over; give such a world an empty queue.

        :param seeds: of each episode; the world's own seed where not given.
        :raises InvalidInput: between policy ticks, slots given twice or out of range, or see the constructor.
        """
        if self.tick % self.config.policy_ticks:
            raise InvalidInput(
                f"episodes start at policy ticks, each {self.config.policy_ticks}; this is tick {self.tick}"
            )
        where = np.array(slots, np.int64)
        if len(np.unique(where)) < len(where) or (where < 0).any() or (where >= len(self.state)).any():
            raise InvalidInput(f"expected different slots from 0 to {len(self.state) - 1}, got {list(slots)}")
        self._idle += int((self.state["status"][where] != IDLE).sum())
        self._ended = np.setdiff1d(self._ended, where)
        return self._start(where, episodes, seeds)

    def _fill(self) -> NDArray[np.void]:
        """Give idle slots to the next episodes of the queue, at policy ticks; return the STARTED events."""
        if self._exhausted or self._idle == 0 or self.tick % self.config.policy_ticks:
            return NO_EVENTS
        idle = np.flatnonzero(self.state["status"] == IDLE)
        episodes = list(itertools.islice(self._queue, len(idle)))
        self._exhausted = len(episodes) < len(idle)
        return self._start(idle[: len(episodes)], episodes, None)

    def _start(
        self, slots: NDArray[np.int64], episodes: Sequence[tuple[int, int]], seeds: Sequence[int] | None
    ) -> NDArray[np.void]:
        scenarios = np.array([self._row(scenario) for scenario, _ in episodes], np.int64)
        numbers = np.array([_episode_number(number) for _, number in episodes], np.int64)
        recordings = np.zeros(len(slots), np.int64)
        if self._recorded is not None:
            recordings[:] = [self._recorded.row(*episode) for episode in episodes]
        spawn_all(
            self.state,
            slots,
            scenarios,
            numbers,
            np.full(len(slots), self.seed, np.uint64) if seeds is None else np.array(seeds, np.uint64),
            self._tables,
            self._recordings,
            recordings,
            self._settings,
        )
        self._idle -= len(slots)
        self._bits[:] = 0
        self._bits[slots] = 1 << STARTED
        return list_events(self.state, self._bits)

    def _row(self, scenario: int) -> int:
        if scenario not in self._rows:
            known = ", ".join(map(str, self._rows))
            raise InvalidInput(f"episode of scenario {scenario}: this world has scenario {known} only")
        return self._rows[scenario]

    def _answers(
        self,
        curvttc: Floats | None,
        critical: NDArray[np.bool_] | NDArray[np.uint8] | None,
        vehicle_action: Floats | None,
        pedestrian_action: Floats | None,
        vehicle_control: Floats | None,
    ) -> Answers:
        batch = len(self.state)
        if (curvttc is None) != (critical is None):
            raise InvalidInput("curvttc and critical come from one message: give both, or neither")
        asked, acts = np.zeros(batch, np.uint8), np.zeros(batch, np.uint8)
        alarms = np.zeros(batch, np.uint8) if critical is None else _codes(critical, batch)
        if self._asks and self.tick % self.config.policy_ticks == 0:
            frame = handover.policy_frame(self.state, self.config)
            asked[:] = frame
            acts[:] = handover.acting(self.state, frame, alarms)
        ttc = _NO_VALUES if curvttc is None else _floats("curvttc", curvttc, (batch,))
        if np.isnan(ttc).any():
            raise InvalidInput(f"curvttc of slot {int(np.argmax(np.isnan(ttc)))} is not a number")
        return Answers(
            curvttc=ttc,
            critical=alarms,
            asked=asked,
            acts=acts,
            vehicle_action=_finite("vehicle_action", vehicle_action, (batch, 2), _NO_ACTIONS),
            pedestrian_action=_finite("pedestrian_action", pedestrian_action, (batch, 2), _NO_ACTIONS),
            vehicle_control=_finite("vehicle_control", vehicle_control, (batch, 3), _NO_CONTROLS),
        )


def _episode_number(number: int) -> int:
    if not 0 <= number < 2**32:
        raise InvalidInput(f"an episode's number must be from 0 to 2^32 - 1, got {number}")
    return number


def _codes(values: NDArray[np.bool_] | NDArray[np.uint8], batch: int) -> NDArray[np.uint8]:
    array = np.asarray(values)
    if array.shape != (batch,):
        raise InvalidInput(f"critical: expected shape ({batch},), got {array.shape}")
    return np.ascontiguousarray(array != 0, dtype=np.uint8)


def _floats(name: str, values: Floats, shape: tuple[int, ...]) -> Floats:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.shape != shape:
        raise InvalidInput(f"{name}: expected shape {shape}, got {array.shape}")
    return array


def _finite(name: str, values: Floats | None, shape: tuple[int, ...], missing: Floats) -> Floats:
    if values is None:
        return missing
    array = _floats(name, values, shape)
    if not np.isfinite(array).all():
        slot = int(np.argwhere(~np.isfinite(array))[0, 0])
        raise InvalidInput(f"{name} of slot {slot}: expected finite numbers, got {array[slot]}")
    return array
