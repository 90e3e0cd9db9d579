"""Experience for the learner: one record per policy step, made from successive states of a world."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world import Scenario
from vpsci_ros.world.observation import ACTION_SIZE, LANE_GRID, LANE_NODES, OBSERVATION_SIZE, observe
from vpsci_ros.world.state import COLLISION, ENDED, GOAL, PARKED_COLLISION
from vpsci_ros.world.tick import Step

# Fields as in vpsci_msgs/Transition, which says what each one holds; `number` counts transitions without gaps.
TRANSITION = np.dtype(
    [
        ("number", "u8"),
        ("scenario", "u1"),
        ("episode", "u4"),
        ("step", "u4"),
        ("curvttc", "f4"),
        ("vehicle_observation", "f4", OBSERVATION_SIZE),
        ("pedestrian_observation", "f4", OBSERVATION_SIZE),
        ("vehicle_action", "f4", ACTION_SIZE),
        ("pedestrian_action", "f4", ACTION_SIZE),
        ("next_curvttc", "f4"),
        ("next_vehicle_observation", "f4", OBSERVATION_SIZE),
        ("next_pedestrian_observation", "f4", OBSERVATION_SIZE),
        ("lane_heading", "f4", LANE_NODES),
        ("vehicle_next_velocity", "f4", 2),
        ("pedestrian_next_velocity", "f4", 2),
        ("collision", "u1"),
        ("vehicle_goal", "u1"),
        ("pedestrian_goal", "u1"),
        ("last", "u1"),
        ("terminal", "u1"),
        ("vehicle_policy_version", "u4"),
        ("pedestrian_policy_version", "u4"),
    ]
)


MOST = 1e6  # no position [m], speed [m/s], acceleration [m/s2] or angle [rad] of a transition is beyond
_FLAGS = ("collision", "vehicle_goal", "pedestrian_goal", "last", "terminal")
_TIMES = ("curvttc", "next_curvttc")
_NUMBERS = [name for name in TRANSITION.names or () if TRANSITION[name].base == np.float32 and name not in _TIMES]


def usable(rows: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return which TRANSITION[n] records may be learned from, bool[n].

    Their numbers are finite and not beyond `MOST`, their CurvTTC [s] is not negative, infinity where there is none, and
    their flags are 0 or 1. One that is not would make a loss, and then every weight, not a number.
    """
    good = np.ones(len(rows), np.bool_)
    for name in _NUMBERS:
        near = np.abs(rows[name]) <= MOST
        good &= near.all(axis=tuple(range(1, near.ndim)))
    for name in _TIMES:
        good &= rows[name] >= 0.0
    for name in _FLAGS:
        good &= rows[name] <= 1
    return good


class TransitionBuilder:
    """Pairs the state of each policy frame with the state one policy period, or the end of the episode, later.

    Call `observe` at every tick, in order. Steps without an answer of both policies make no transition and end the
    history: what the rule-based pair does in their place is not the policies' experience.

    :param scenarios: of the world: where its lanes go is part of a transition.
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        self._lanes = {scenario.number: _lane_headings(scenario) for scenario in scenarios}
        self.count = 0  # transitions made so far
        self._pending = np.zeros(0, TRANSITION)
        self._open = np.zeros(0, bool)
        self._heading = np.zeros(0)

    def clear(self) -> None:
        """Forget what was begun: other episodes begin. Numbers go on."""
        self._open[:] = False

    def observe(self, step: Step, vehicle_version: int = 0, pedestrian_version: int = 0) -> NDArray[np.void]:
        """Take one tick in and return the transitions that it completes, TRANSITION[n].

        :param step: whose actions are the policies'.
        :param vehicle_version, pedestrian_version: of the weights by which they acted.
        """
        (_, state, policy_frame, _), assessment, actions = step.tick, step.assessment, step.actions
        if len(self._open) != len(state):
            self._pending, self._open = np.zeros(len(state), TRANSITION), np.zeros(len(state), bool)
            self._heading = np.zeros(len(state))
        acts = assessment.acting
        if actions.vehicle is None or actions.pedestrian is None:
            acts = np.zeros_like(acts)
        due = self._open & (policy_frame | (state["status"] == ENDED))
        if not (due.any() or acts.any()):
            return np.zeros(0, TRANSITION)
        observations = observe(state)
        rows = self._complete(state, assessment.curvttc, observations, due, acts)
        if acts.any():
            self._begin(state, assessment.curvttc, observations, acts, (actions.vehicle, actions.pedestrian))
            self._pending["vehicle_policy_version"][acts] = vehicle_version
            self._pending["pedestrian_policy_version"][acts] = pedestrian_version
        return rows

    def _begin(self, state, curvttc, observations, acts, actions) -> None:  # type: ignore[no-untyped-def]
        pending = self._pending
        for name in ("scenario", "episode", "vehicle_goal", "pedestrian_goal"):
            pending[name][acts] = state[name][acts]
        pending["step"][acts] = np.where(state["controlled"] == 0, 0, state["step"])[acts]
        pending["curvttc"][acts] = curvttc[acts]
        for agent, observation, action in zip(("vehicle", "pedestrian"), observations, actions, strict=True):
            pending[f"{agent}_observation"][acts] = observation[acts]
            pending[f"{agent}_action"][acts] = np.asarray(action)[acts]
        self._heading[acts] = state["vehicle_heading"][acts]
        pending["lane_heading"][acts] = self._lanes_ahead(state[acts])
        self._open |= acts

    def _complete(self, state, curvttc, observations, due, acts) -> NDArray[np.void]:  # type: ignore[no-untyped-def]
        rows = self._pending[due]
        now = state[due]
        self._open &= ~due
        rows["number"] = self.count + np.arange(len(rows), dtype=np.uint64)
        self.count += len(rows)
        rows["next_curvttc"] = curvttc[due]
        heading = self._heading[due]
        direction = now["vehicle_heading"]
        velocities = {
            "vehicle": (now["vehicle_speed"] * np.cos(direction), now["vehicle_speed"] * np.sin(direction)),
            "pedestrian": (now["pedestrian_vx"], now["pedestrian_vy"]),
        }
        c, s = np.cos(heading), np.sin(heading)
        for (agent, (east, north)), observation in zip(velocities.items(), observations, strict=True):
            rows[f"next_{agent}_observation"] = observation[due]
            rows[f"{agent}_next_velocity"] = np.stack([c * east + s * north, c * north - s * east], axis=1)
            rows[f"{agent}_goal"] = (now[f"{agent}_goal"] != 0) & (rows[f"{agent}_goal"] == 0)
        ended = now["status"] == ENDED
        rows["collision"] = ended & (now["outcome"] == COLLISION)
        rows["terminal"] = ended & np.isin(now["outcome"], (COLLISION, GOAL, PARKED_COLLISION))
        rows["last"] = ended | ~acts[due] | (now["controlled"] == 0)
        return rows

    def _lanes_ahead(self, state: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the lane's direction from the vehicle on, float64[n, LANE_NODES] [rad], relative to its heading."""
        ahead = np.zeros((len(state), LANE_NODES))
        for row, episode in zip(ahead, state, strict=True):
            s, heading = self._lanes[int(episode["scenario"])]
            row[:] = np.interp(episode["route_s"] + LANE_GRID * np.arange(LANE_NODES), s, heading)
        ahead -= state["vehicle_heading"][:, None]
        turns = np.round(ahead[:, :1] / (2.0 * np.pi))  # headings of the two may be whole turns apart
        return ahead - 2.0 * np.pi * turns


def _lane_headings(scenario: Scenario) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return arc lengths [m] along a scenario's lane and its direction there [rad], without jumps."""
    path = scenario.vehicle.path
    s = np.arange(0.0, path.length, path.step)
    return s, np.unwrap([path.heading(at) for at in s])
