"""What `Pedestrian` and `Driver` share: a world of one episode, whose state your engine overwrites between ticks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path as File
from typing import Any, Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.cosim.inputs import State, Vehicle, Walker
from vpsci_ros.documents import require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.compiling import compile_kernels
from vpsci_ros.policy.policy_config import PolicyConfig
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.safety import CRITICAL_TTC, curvttc
from vpsci_ros.world import EPISODE, RUNNING, Scenario, World, WorldConfig, load_scenario
from vpsci_ros.world.crowd import MOST
from vpsci_ros.world.kinds import KINDS
from vpsci_ros.world.observation import to_heading_frame
from vpsci_ros.world.paths import nearest, project
from vpsci_ros.world.tables import tables_from
from vpsci_ros.world.tick import Actions

AWAY = 1e5  # [m] from the vehicle, the place of a pedestrian that does not exist
NEAR = 2.0  # [m] an agent that moved less is searched near its last place on its way
_KINDS: dict[str, tuple[type, ...]] = {
    **dict.fromkeys(("seed", "episode", "number"), (int, np.integer)),
    "scenario": (int, str, File, Scenario, type(None)),
    "speed": (float, int, np.number, type(None)),
    "config": (WorldConfig, type(None)),
    "policy": (PolicyConfig, type(None)),
}  # of an agent's constructor


class Person(NamedTuple):
    """What is drawn for an agent, by seed, scenario and episode: kind, speed, reaction delay and recorded reaction.

    :ivar kind: of `vpsci_ros.world.kinds.KINDS`; a driver's is that of its first pedestrian.
    :ivar speed: [m/s] with nothing near.
    :ivar reaction_delay: [s] after the hand-over before a pedestrian reacts; infinity: never.
    :ivar recorded: number of the recorded situation whose reaction is replayed, drawn at the hand-over; -1: none.
    :ivar beyond: whether the last hand-over lay beyond the range of the source; None: no hand-over yet, or no bank.
    """

    kind: str
    speed: float
    reaction_delay: float
    recorded: int
    beyond: bool | None = None


class Agent(Generic[State]):
    """One episode with a row for each of at most `MOST` pedestrians; your engine places all road users.

    Your engine's steps may be shorter or longer than ticks; the agent decides every tick. For a tick that begins within
    a step, all others keep their motion since the beginning of that step.
    """

    _what: str  # "vehicle" or "pedestrian"
    _kind: Any  # `State`
    _ways: tuple[str, ...]  # arguments of the constructor of which one says where it goes
    _speeds: tuple[float, float, str]  # least, greatest [m/s], in words
    _paced: tuple[str, str]  # fields of the state: its pace, and that it sets off as recorded

    def __init__(self, given: Mapping[str, Any]) -> None:
        """Check the arguments of the constructor; `_make` follows at once where `scenario` is given."""
        who, scenario, self._speed = type(self).__name__, given["scenario"], given["speed"]
        require_form(given, {name: kinds for name, kinds in _KINDS.items() if name in given}, who)
        if len(named := [name for name in self._ways if given[name] is not None]) != 1:
            ways = f"{', '.join(self._ways[:-1])} and {self._ways[-1]}"
            raise InvalidInput(f"{who}: expected one of {ways}, got {named or 'none of them'}")
        low, high, words = self._speeds
        if self._speed is not None and not low <= self._speed <= high:
            raise InvalidInput(f"speed = {self._speed!r}: expected {words}")
        drives, walks = ("policy", "external") if self._what == "vehicle" else ("external", "policy")
        self._config = replace(given["config"] or WorldConfig(), vehicle_driver=drives, pedestrian_driver=walks)
        weights = given["weights"]
        own = load_policy(weights) if isinstance(weights, (str, File)) else weights
        self._drawn = own, given["seed"], given["episode"], given["policy"]
        self._number, self._tick_time, self._left = given.get("number", 0), round(self._config.tick * 1e9), 0  # [ns]
        self._state = np.zeros(0, EPISODE)
        if scenario is not None:
            self._make(scenario if isinstance(scenario, Scenario) else load_scenario(scenario))

    def _make(self, scenario: Scenario, **values: float) -> None:
        """Begin the episode, with these values of fields of the state in all rows.

        :raises InvalidInput: it has no such pedestrian, or as `World` and the configurations.
        """
        own, seed, episode, policy = self._drawn
        compile_kernels(own)
        config, number = self._config, self._number
        spawned = World(config, [scenario], [(scenario.number, episode)], 1, seed).state
        if not 0 <= number < len(spawned) or spawned["status"][number] != RUNNING:
            most = int(spawned["pedestrians"][0])
            raise InvalidInput(f"number = {number}: episode {episode} of seed {seed} has pedestrians 0 to {most - 1}")
        self._world = World(replace(config, pedestrians=MOST), [scenario], [], 1, seed)
        self._world.place([0], [(scenario.number, episode)])
        self._state, self._tables = self._world.state, tables_from([scenario], config.spawn)
        self._state[:] = spawned[number]
        self._state[: len(spawned)] = spawned
        self._state["pedestrian"] = np.arange(MOST)
        self._policy = policies(own, self._world, None if policy is None else {self._what: policy})[self._what]
        if self._policy.keeps_lane:
            self._world.keep_lane()
        self._parked = scenario.parked
        self._unit = scenario.vehicle.full_throttle_speed if self._what == "vehicle" else 1.0  # [m/s] of its pace
        if self._speed is not None:
            values |= dict(zip(self._paced, (self._speed / self._unit, 0), strict=True))
        for name, value in values.items():
            self._state[name] = value

    @property
    def _record(self) -> np.void:
        """The agent's EPISODE record, a view into `_state`; made at each access, as a copy has a state of its own."""
        if not len(self._state):
            raise InvalidInput("this pedestrian walks to a goal from where it is: call step first")
        record: np.void = self._state[self._number]
        return record

    @property
    def start(self) -> State:
        """Its state, as in `step`: before the first step at the spawn, later at the end of the last tick begun.

        :raises InvalidInput: before the first step of a pedestrian with a `goal`.
        """
        record = self._record
        found: State = self._kind(*(float(record[f"{self._what}_{name}"]) for name in self._kind._fields[:6]))
        return found

    @property
    def person(self) -> Person:
        """The drawn person; before the hand-over, `recorded` is -1 and `beyond` is None.

        :raises InvalidInput: before the first step of a pedestrian with a `goal`.
        """
        record, number = self._record, self._number
        kind, pace = KINDS[int(record["kind"])], float(record[self._paced[0]]) * self._unit
        delay = float(record["reaction_delay"])
        return Person(kind, pace, delay, self._policy.recorded(number), self._policy.beyond(number))

    def _moved(
        self, now: State, period: int, tick: Callable[[State, float], None], partly: Callable[[State, float], State]
    ) -> State:
        """Return the agent's state after a step of `period` [ns].

        :param tick: begins a tick of the world, with the agent's state and the time since the step began [s].
        :param partly: returns the state after a part [s] of a tick.
        """
        gone = 0
        while gone < period:
            if self._left == 0:
                tick(now, gone * 1e-9)
                self._left = self._tick_time
            part = min(self._left, period - gone)
            now = self.start if part == self._tick_time else partly(now, part * 1e-9)
            self._left, gone = self._left - part, gone + part
        return now

    def _put(self, vehicle: Vehicle | None, walkers: Sequence[Walker | None]) -> None:
        """Write a vehicle, complete, into all rows, and pedestrians into the rows from the first on; None: nobody."""
        for name in Vehicle._fields[:6] if vehicle else ():
            self._state[f"vehicle_{name}"] = getattr(vehicle, name)
        for row, walker in enumerate(walkers):
            there = Walker(self._record["vehicle_x"] + AWAY, AWAY) if walker is None else walker
            for name, value in there._asdict().items():
                self._state[f"pedestrian_{name}"][row] = value
        self._state["pedestrians"] = len(walkers)

    def _locate(self, x: float, y: float) -> None:
        """Set the agent's arc length on its path from its place (x, y) [m], unless unchanged.

        An agent that moved by `NEAR` or more no longer follows the recorded motion before its onset.
        """
        record, what = self._record, self._what
        if (record[f"{what}_x"], record[f"{what}_y"]) == (x, y):
            return
        rows, table = slice(self._number, self._number + 1), int(record["table"])
        name, points, side = "pedestrian_s", self._tables.walk, "walk"
        if what == "vehicle":
            rows, name, points, side = slice(None), "route_s", self._tables.lane, "lane"
        row = self._tables.rows[table]
        way = points, table, int(row[f"{side}_count"]), float(row[f"{side}_step"])
        if np.hypot(x - record[f"{what}_x"], y - record[f"{what}_y"]) < NEAR:
            place, _ = project(*way, x, y, float(record[name]))
        else:
            place = nearest(*way, x, y)
            self._state[self._paced[1]] = 0  # no recorded way leads there
        self._state[name][rows] = place

    def _advance(
        self,
        ttc: NDArray[np.float64],
        distance: NDArray[np.float64],
        parked: NDArray[np.float64],
        push: tuple[float, float] | None = None,
    ) -> None:
        """Let the policy decide and the world move all agents by one tick.

        :param ttc: float64[MOST] [s]; distance: float64[MOST] [m]; infinity and NaN in empty rows.
        :param push: acceleration of the pedestrian, east and north [m/s2], in place of the policy's.
        """
        self._state["status"] = np.where(np.arange(MOST) < self._record["pedestrians"], RUNNING, 0)
        self._world.resume(parked)
        now, rows = self._world.now, len(self._state)
        assessment = now.assessed(ttc, distance, ttc < CRITICAL_TTC)
        actions = Actions(vehicle_control=np.zeros((rows, 3)), pedestrian=np.zeros((rows, 2)))
        if now.policy_frame.any():
            action = self._policy.act(now, assessment).astype(np.float64)
            if push is not None:
                action[self._number] = to_heading_frame(float(self._record["vehicle_heading"]), *push)
            actions = replace(actions, **{self._what: action})
        self._world.advance(assessment, actions)


def seen(vehicles: Sequence[Vehicle], walkers: Sequence[Walker]) -> tuple[NDArray[np.float64], ...]:
    """Return CurvTTC [s] and centre distance [m] of n pairs, float64[n]; a single agent is in all of them."""
    cars, people = np.array(vehicles, np.float64).T, np.array(walkers, np.float64).T
    ttc = curvttc(*cars[:5], *people, length=cars[6], width=cars[7])
    return ttc, np.sqrt((cars[0] - people[0]) ** 2 + (cars[1] - people[1]) ** 2)
