"""The world: a batch of parallel episodes, advanced tick by tick, refilled from a queue as episodes end."""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety.compiled import in_threads
from vpsci_ros.world import engine, handover, spawn
from vpsci_ros.world.compiled import PER_THREAD, SPAWNS_PER_THREAD
from vpsci_ros.world.parked import end_crashed, in_sight, parked_from
from vpsci_ros.world.recordings import NO_RECORDINGS, Recorded
from vpsci_ros.world.scenario import Points, Scenario
from vpsci_ros.world.state import ENDED, EPISODE, IDLE, NO_EVENTS, NONE, RUNNING, concat_events, list_events
from vpsci_ros.world.tables import Inputs, crowd_from, settings_from, tables_from
from vpsci_ros.world.tick import NO_ACTIONS, Actions, Assessment, Floats, Tick
from vpsci_ros.world.world_config import WorldConfig

_NO_VALUES = np.empty(0)
_NO_PAIRS, _NO_CONTROLS = np.empty((0, 2)), np.empty((0, 3))


class World:
    """`batch` parallel episodes of one vehicle and its pedestrians, in lock-step.

    With `config.pedestrians` of P each episode has P rows in a row in every array, B = `batch` P in all; row r is the
    pair of the vehicle of episode r // P, which is the same in all of its rows, and pedestrian r % P. An episode with
    fewer pedestrians leaves its last rows idle; its rows begin and end together.

    An episode is a pure function of (seed, scenario, number) and of the answers it gets: its bits do not depend on
    the batch, on its slot or on the other episodes. Fresh episodes enter at policy ticks only, so that all slots have
    their policy frames at the same ticks. The last frame of an episode is shown for one tick, with status ENDED.

    :param episodes: (scenario number, episode number) in the order in which slots take them; read as slots become
        free, so it may be an endless iterator.
    :param recorded: motion of the agents whose driver is "replay".
    :param first_tick: number of the first tick, a policy tick.
    :param head_starts: (scenario, episode) -> the time [s] by which its pedestrians are further on than drawn, and the
        time for which they have walked straight on since; a replayed pedestrian has none.
    :ivar now: the present tick; its state is the world's own array, valid until the next one.
    :raises InvalidInput: no scenario, two with one number, a batch below 1, a seed or an episode number out of range,
        an episode whose scenario is not given or which has no recording though one is needed.
    """

    def __init__(
        self,
        config: WorldConfig,
        scenarios: Sequence[Scenario],
        episodes: Iterable[tuple[int, int]],
        batch: int,
        seed: int,
        recorded: Recorded | None = None,
        first_tick: int = 0,
        head_starts: Mapping[tuple[int, int], tuple[float, float]] | None = None,
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
        self._most = config.pedestrians
        rows = batch * self._most
        self.state: NDArray[np.void] = np.zeros(rows, EPISODE)
        self._no_slots = np.zeros(rows, np.bool_)
        if "replay" in (config.vehicle_driver, config.pedestrian_driver) and recorded is None:
            raise InvalidInput(
                "a replay driver needs recordings: World(..., recorded=...), or the node's parameter recorded_bag"
            )
        self._recorded = recorded
        self._recordings = NO_RECORDINGS if recorded is None else recorded.arrays
        self._has_policies = "policy" in (config.vehicle_driver, config.pedestrian_driver)
        self._settings = settings_from(config)
        self._crowd = crowd_from(config)
        self._head_starts = head_starts or {}
        self._tables = tables_from(scenarios, config.spawn)
        self._parked = parked_from(scenarios)
        self._queue: Iterator[tuple[int, int]] = iter(episodes)
        self._exhausted = False
        self._bits = np.zeros(rows, np.uint16)
        self._pushes = np.zeros((rows if self._most > 1 else 0, 2))
        self._before = np.zeros((rows, engine.PLACES))
        self._idle = batch
        self._ended: NDArray[np.int64] = np.empty(0, np.int64)
        self._started = self._begin(first_tick)

    @property
    def done(self) -> bool:
        """Whether every episode of the queue has ended and every slot is idle."""
        return self._exhausted and self._idle == len(self.state) // self._most

    def keep_lane(self) -> None:
        """Keep the vehicle's lane from now on, for an agent that does not steer, see `WorldConfig.lane_following`."""
        self.config = replace(self.config, lane_following=True)
        self._settings = settings_from(self.config)

    def take_started(self) -> NDArray[np.void]:
        """Return the STARTED events of the first tick, EVENT[n]."""
        return self._started

    def advance(self, assessment: Assessment, actions: Actions = NO_ACTIONS) -> NDArray[np.void]:
        """Advance to the next tick with the answers to the present one, and return the events, EVENT[n].

        Policies' actions are used where they act, and stay in force until the next policy frame; an external driver's
        are used at once, everywhere, `vehicle_control` rather than `vehicle`. Without an action the rule-based driver
        acts until the next one.

        :param assessment: made by `now`.
        :raises InvalidInput: actions for another number of slots.
        """
        answers = self._answers(assessment, actions)
        engine.decide(self.state, answers, self._settings, self._bits)
        decided = list_events(self.state, self._bits)
        if len(self._ended):
            whole = self.state.view(np.uint8).reshape(len(self.state), -1)  # to write rows by their fields is slow
            whole[self._ended] = 0
            self._idle += int(np.count_nonzero(self._ended % self._most == 0))
        in_threads(lambda part: self._move(answers, part), len(self.state), PER_THREAD, self._most)
        if self._parked is not None:
            end_crashed(self.state, self._parked, self._bits)
        self._ended = self._bits.nonzero()[0]
        arrived = list_events(self.state, self._bits)
        happened = [events for events in (decided, arrived, self._begin(self.now.number + 1)) if len(events)]
        return concat_events(happened)

    def _move(self, answers: Inputs, part: slice) -> None:
        own = Inputs(*(array[part] for array in answers))  # type: ignore[arg-type]  # length 0 stays 0
        scratch = self._pushes[part], self._before[part]
        move = engine.move_one if self._most == 1 else engine.move_several
        move(self.state[part], own, self._tables, self._recordings, self._settings, *scratch, self._bits[part])

    def place(
        self, slots: Sequence[int], episodes: Sequence[tuple[int, int]], seeds: Sequence[int] | None = None
    ) -> NDArray[np.void]:
        """Start these episodes in these slots, replacing running ones; return their STARTED events, EVENT[n].

        `place` is for environments that decide themselves when an episode is over; give such a world an empty queue.

        :param slots: places in the batch, from 0 to `batch` - 1.
        :param seeds: of each episode; the world's own seed where not given.
        :raises InvalidInput: between policy ticks, slots given twice or out of range, or see the constructor.
        """
        tick, every = self.now.number, self.config.policy_ticks
        if tick % every:
            raise InvalidInput(f"episodes start at policy ticks, each {every}; this is tick {tick}")
        where, room = np.array(slots, np.int64), len(self.state) // self._most
        if len(np.unique(where)) < len(where) or (where < 0).any() or (where >= room).any():
            raise InvalidInput(f"expected different slots from 0 to {room - 1}, got {list(slots)}")
        where *= self._most
        self._idle += int((self.state["status"][where] != IDLE).sum())
        if self._most > 1:
            self.state.reshape(-1, self._most)[where // self._most] = 0
        self._ended = self._ended[~np.isin(self._ended // self._most * self._most, where)]
        started = self._start(where, episodes, seeds)
        self._show(tick)
        return started

    def resume(self, parked: Points) -> None:
        """Refresh the present tick after another engine has set positions in `state`.

        Episodes that have ended run again: the other engine decides when an episode is over.

        :param parked: vehicles that stand now, float64[K, 5], see `vpsci_ros.world.scenario.Scenario.parked`.
        """
        ended = self.state["status"] == ENDED
        self.state["status"][ended], self.state["outcome"][ended] = RUNNING, NONE
        self._ended = self._ended[:0]
        self._parked = parked_from([replace(scenario, parked=parked) for scenario in self.scenarios])
        self._show(self.now.number)

    def _begin(self, tick: int) -> NDArray[np.void]:
        """Begin a tick; at policy ticks, idle slots take the next episodes of the queue. Return the STARTED events."""
        started = NO_EVENTS if tick % self.config.policy_ticks else self._fill()
        self._show(tick)
        return started

    def _show(self, tick: int) -> None:
        policy_tick = tick % self.config.policy_ticks == 0
        frame = handover.policy_frame(self.state, self.config) if policy_tick else self._no_slots
        if self._parked is not None and policy_tick:
            frame &= (self.state["controlled"] != 0) | in_sight(self.state, self._parked)
        self.now = Tick(number=tick, state=self.state, policy_frame=frame, by_policies=self._has_policies)

    def _fill(self) -> NDArray[np.void]:
        if self._exhausted or self._idle == 0:
            return NO_EVENTS
        idle = np.flatnonzero(self.state["status"][:: self._most] == IDLE) * self._most
        episodes = list(itertools.islice(self._queue, len(idle)))
        self._exhausted = len(episodes) < len(idle)
        if not episodes:  # and what starts them need not even be compiled
            return NO_EVENTS
        return self._start(idle[: len(episodes)], episodes, None)

    def _start(
        self, slots: NDArray[np.int64], episodes: Sequence[tuple[int, int]], seeds: Sequence[int] | None
    ) -> NDArray[np.void]:
        scenarios = np.array([self._row(scenario) for scenario, _ in episodes], np.int64)
        numbers = np.array([_episode_number(number) for _, number in episodes], np.int64)
        recordings = np.zeros(len(slots), np.int64)
        if self._recorded is not None:
            recordings[:] = [self._recorded.row(*episode) for episode in episodes]
        keys = np.full(len(slots), self.seed, np.uint64) if seeds is None else np.array(seeds, np.uint64)
        ahead = np.array([self._head_starts.get(key, (0.0, 0.0)) for key in episodes]) if self._head_starts else None
        drives, state, tables, settings = np.empty(len(slots)), self.state, self._tables, self._settings
        self._bits[:] = 0

        def run(part: slice) -> None:
            own, crowd = slots[part], self._crowd
            what = scenarios[part], numbers[part], keys[part], recordings[part]
            spawn.begin_all(state, own, *what, tables, crowd, settings, drives[part], self._bits)
            if self._most > 1:
                spawn.join_all(state, own, keys[part], tables, crowd, settings, drives[part], self._bits)
            if ahead is not None and self.config.pedestrian_driver != "replay":
                spawn.give_head_starts(state, own, ahead[part], tables, settings)
            if self._recorded is not None:
                spawn.place_recorded(state, own, tables, self._recordings, settings)

        in_threads(run, len(slots), SPAWNS_PER_THREAD)
        self._idle -= len(slots)
        return list_events(self.state, self._bits)

    def _row(self, scenario: int) -> int:
        if scenario not in self._rows:
            known = ", ".join(map(str, self._rows))
            raise InvalidInput(f"episode of scenario {scenario}: this world has scenario {known} only")
        return self._rows[scenario]

    def _answers(self, assessment: Assessment, actions: Actions) -> Inputs:
        """Return the answers as compiled code takes them."""
        return Inputs(
            curvttc=assessment.curvttc if assessment.answered else _NO_VALUES,
            critical=assessment.critical.view(np.uint8),
            policy_frame=(self.now.policy_frame if self._has_policies else self._no_slots).view(np.uint8),
            acts=assessment.acting.view(np.uint8),
            vehicle_action=self._given("vehicle", actions.vehicle, _NO_PAIRS),
            pedestrian_action=self._given("pedestrian", actions.pedestrian, _NO_PAIRS),
            vehicle_control=self._given("vehicle_control", actions.vehicle_control, _NO_CONTROLS),
        )

    def _given(self, name: str, values: Floats | None, missing: Floats) -> Floats:
        if values is None:
            return missing
        if len(values) != len(self.state):
            raise InvalidInput(
                f"actions.{name}: expected one row for each of {len(self.state)} slots, got {len(values)}"
            )
        return values


def _episode_number(number: int) -> int:
    if not 0 <= number < 2**32:
        raise InvalidInput(f"an episode's number must be from 0 to 2^32 - 1, got {number}")
    return number
