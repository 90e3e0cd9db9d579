"""The base of `Pedestrian` and `Driver`: a world of one episode, whose state your engine overwrites between ticks."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as File
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.cosim.inputs import Vehicle, Walker
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.compiling import compile_kernels
from vpsci_ros.policy.policy_config import PolicyConfig
from vpsci_ros.policy.policy_file import Policy, load_policy
from vpsci_ros.safety import CRITICAL_TTC, curvttc
from vpsci_ros.world import RUNNING, World, WorldConfig
from vpsci_ros.world.crowd import MOST
from vpsci_ros.world.kinds import KINDS
from vpsci_ros.world.observation import to_heading_frame
from vpsci_ros.world.paths import Path, nearest, project
from vpsci_ros.world.scenario import Scenario
from vpsci_ros.world.tables import tables_from
from vpsci_ros.world.tick import Actions

AWAY = 1e5  # [m] from the vehicle, the place of a pedestrian that does not exist
NEAR = 2.0  # [m] an agent that moved less is searched near its last place on its way


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


class Body:
    """One episode with a row for each of at most `MOST` pedestrians; your engine places all road users.

    :param agent: "vehicle" or "pedestrian": the agent that the policy moves.
    :param number: of the pedestrian within its episode; its row.
    :ivar parked: parked vehicles of the scenario, float64[K, 5].
    :raises InvalidInput: the episode has no such pedestrian, or as `World`, `load_policy` and the configurations.
    """

    def __init__(
        self,
        agent: str,
        weights: str | File | Policy,
        scenario: Scenario,
        seed: int,
        episode: int,
        number: int,
        config: WorldConfig,
        policy: PolicyConfig | None,
    ) -> None:
        own = load_policy(weights) if isinstance(weights, (str, File)) else weights
        compile_kernels(own)
        self.parked = scenario.parked
        drives, walks = ("policy", "external") if agent == "vehicle" else ("external", "policy")
        config = replace(config, vehicle_driver=drives, pedestrian_driver=walks)
        spawned = World(config, [scenario], [(scenario.number, episode)], 1, seed).state
        if not 0 <= number < len(spawned) or spawned["status"][number] != RUNNING:
            most = int(spawned["pedestrians"][0])
            raise InvalidInput(f"number = {number}: episode {episode} of seed {seed} has pedestrians 0 to {most - 1}")
        self.world = World(replace(config, pedestrians=MOST), [scenario], [], 1, seed)
        self.world.place([0], [(scenario.number, episode)])
        self.state, self.tables = self.world.state, tables_from([scenario], config.spawn)
        self.state[:] = spawned[number]
        self.state[: len(spawned)] = spawned
        self.state["pedestrian"] = np.arange(MOST)
        self.agent = policies(own, self.world, None if policy is None else {agent: policy})[agent]
        if self.agent.keeps_lane:
            self.world.keep_lane()
        self._number, self._agent = number, agent

    @property
    def record(self) -> np.void:
        """The agent's EPISODE record, a view into `state`; made at each access, as a copied body has its own state."""
        record: np.void = self.state[self._number]
        return record

    @property
    def walk(self) -> Path:
        """The pedestrian's route, in its own direction."""
        path = self.world.scenarios[0].pedestrian.path
        return path if self.record["table"] == 0 else replace(path, points=path.points[::-1])

    def person(self, speed: float) -> Person:
        """Return what was drawn for this agent, see `Person`, with `speed` [m/s] as given.

        Before the hand-over, `recorded` is -1 and `beyond` None.
        """
        record = self.record
        kind, delay = KINDS[int(record["kind"])], float(record["reaction_delay"])
        return Person(kind, speed, delay, self.agent.recorded(self._number), self.agent.beyond(self._number))

    def begin(self, **values: float) -> None:
        """Overwrite the given fields of the state in all rows."""
        for name, value in values.items():
            self.state[name] = value

    def put_vehicle(self, vehicle: Vehicle) -> None:
        """Write a vehicle into all rows; its curvature and acceleration must not be None."""
        for name in ("x", "y", "heading", "speed", "curvature", "acceleration"):
            self.state[f"vehicle_{name}"] = getattr(vehicle, name)

    def put_walkers(self, walkers: Sequence[Walker | None]) -> None:
        """Write pedestrians into the rows, from the first row on; None leaves a row empty."""
        for row, walker in enumerate(walkers):
            there = Walker(self.record["vehicle_x"] + AWAY, AWAY) if walker is None else walker
            for name, value in there._asdict().items():
                self.state[f"pedestrian_{name}"][row] = value
        self.state["pedestrians"] = len(walkers)

    def locate(self, what: str, x: float, y: float) -> None:
        """Set the arc length of "vehicle" or "pedestrian" on its path from its place (x, y) [m], unless unchanged.

        An agent that moved by `NEAR` or more no longer follows the recorded motion before its onset.
        """
        record = self.record
        if (record[f"{what}_x"], record[f"{what}_y"]) == (x, y):
            return
        name, points, side = {
            "vehicle": ("route_s", self.tables.lane, "lane"),
            "pedestrian": ("pedestrian_s", self.tables.walk, "walk"),
        }[what]
        row = self.tables.rows[record["table"]]
        way = points, int(record["table"]), int(row[f"{side}_count"]), float(row[f"{side}_step"])
        if np.hypot(x - record[f"{what}_x"], y - record[f"{what}_y"]) < NEAR:
            place, _ = project(*way, x, y, float(record[name]))
        else:
            place = nearest(*way, x, y)
            self.state["driver_onset" if what == "vehicle" else "walker_onset"] = 0  # no recorded way leads there
        self.state[name][self.rows(what)] = place

    def rows(self, what: str) -> slice:
        """Return the rows of `state` with the agent: all rows for "vehicle", its own row for "pedestrian"."""
        return slice(None) if what == "vehicle" else slice(self._number, self._number + 1)

    def tick(
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
        self.state["status"] = np.where(np.arange(MOST) < self.record["pedestrians"], RUNNING, 0)
        self.world.resume(parked)
        now, rows = self.world.now, len(self.state)
        assessment = now.assessed(ttc, distance, ttc < CRITICAL_TTC)
        actions = Actions(vehicle_control=np.zeros((rows, 3)), pedestrian=np.zeros((rows, 2)))
        if now.policy_frame.any():
            action = self.agent.act(now, assessment).astype(np.float64)
            if push is not None:
                action[self._number] = to_heading_frame(float(self.record["vehicle_heading"]), *push)
            actions = replace(actions, **{self._agent: action})
        self.world.advance(assessment, actions)

    def seen(self, vehicles: Sequence[Vehicle], walkers: Sequence[Walker]) -> tuple[NDArray[np.float64], ...]:
        """Return CurvTTC [s] and centre distance [m] of n pairs, float64[n]; a single agent is in all of them."""
        cars, people = np.array(vehicles, np.float64).T, np.array(walkers, np.float64).T
        ttc = curvttc(*cars[:5], *people, length=cars[6], width=cars[7])
        return ttc, np.sqrt((cars[0] - people[0]) ** 2 + (cars[1] - people[1]) ** 2)


class Clock:
    """Division of your engine's steps into ticks of the world; steps may be shorter or longer than ticks.

    The agent decides every tick. For a tick that begins within a step, all others keep their motion since the
    beginning of that step.
    """

    def __init__(self, tick: float) -> None:
        self.tick = round(tick * 1e9)  # [ns]
        self.left = 0  # [ns] of the present tick

    def parts(self, period: int) -> list[tuple[bool, int, float]]:
        """Return the parts of a step of `period` [ns]: (whether a tick begins, length [ns], begin in the step [s])."""
        parts, gone = [], 0
        while gone < period:
            begins = self.left == 0
            if begins:
                self.left = self.tick
            part = min(self.left, period - gone)
            parts.append((begins, part, gone * 1e-9))
            self.left -= part
            gone += part
        return parts
