"""Experience for the learner: one record per policy step, made from successive states of a world."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.policy.histories import Histories
from vpsci_ros.world import Scenario, WorldConfig
from vpsci_ros.world.observation import AGENTS, observe
from vpsci_ros.world.road import road_of
from vpsci_ros.world.state import COLLISION, ENDED, GOAL, PARKED_COLLISION
from vpsci_ros.world.tables import settings_from, tables_from
from vpsci_ros.world.tick import Step
from vpsci_ros.world.transition import TRANSITION

STEPS = 128  # of a history, before its memory doubles
MOST = 1e6  # no position [m], speed [m/s], acceleration [m/s2] or angle [rad] of a transition is beyond
_FLAGS = ("acting", "keeps_lane", "limited", "collision", "vehicle_goal", "pedestrian_goal", "last", "terminal")
_ROAD = ("lane", "way", "wanted", "release", "pedestrian_gain", "keeps_lane", "limited")  # as in `Road`
_TIMES = ("curvttc", "next_curvttc")
_NUMBERS = [name for name in TRANSITION.names or () if TRANSITION[name].base == np.float32 and name not in _TIMES]


def usable(rows: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return which TRANSITION[n] records may be learned from, bool[n].

    Usable records have finite numbers within `MOST`, a CurvTTC [s] that is not negative (infinity: no contact), flags
    of 0 or 1, and policies that act at the first step of a history. Other records would make a loss, and then every
    weight, not a number.
    """
    good = np.ones(len(rows), np.bool_)
    for name in _NUMBERS:
        near = np.abs(rows[name]) <= MOST
        good &= near.all(axis=tuple(range(1, near.ndim)))
    for name in _TIMES:
        good &= rows[name] >= 0.0
    for name in _FLAGS:
        good &= rows[name] <= 1
    good &= (rows["step"] != 0) | (rows["acting"] != 0)
    return good


Completed = tuple[NDArray[np.void], list[NDArray[np.void]]]
"""Transitions, TRANSITION[n], in the order of the slots; histories that end with one of them, whole, TRANSITION[T]."""


class TransitionBuilder:
    """Pairs the state of each policy frame with the state one policy period later, or with the episode's last state.

    Records of an episode begin with its first hand-over and end with the episode. While the rule-based pair acts, also
    in place of a missing answer, a transition has the accelerations of the motion and is not `acting`. Call `observe`
    at every tick, in order.

    :param config, scenarios: of the world.
    :ivar count: transitions completed so far.
    """

    def __init__(self, config: WorldConfig, scenarios: Sequence[Scenario]) -> None:
        self.count = 0
        self._tables, self._settings = tables_from(scenarios, config.spawn), settings_from(config)
        self._resize(0)

    def _resize(self, slots: int) -> None:
        self._steps = np.zeros((slots, STEPS), TRANSITION)  # of the history under way in each slot
        self._begun = np.zeros(slots, np.int64)  # how many of them have begun
        self._open = np.zeros(slots, np.bool_)  # the last of them has no next state yet
        self._histories = Histories(slots)

    def observe(self, step: Step, vehicle_version: int = 0, pedestrian_version: int = 0) -> Completed:
        """Process one tick; return the transitions that it completes, and the histories that these end.

        :param step: whose actions are the policies'.
        :param vehicle_version, pedestrian_version: versions of the weights by which the agents acted.
        """
        (_, state, policy_frame, _), assessment, actions = step.tick, step.assessment, step.actions
        if len(self._open) != len(state):
            self._resize(len(state))
        answered = actions.vehicle is not None and actions.pedestrian is not None
        acts = assessment.acting & answered
        _, steps = self._histories.take(state, policy_frame, acts)
        due = self._open & (policy_frame | (state["status"] == ENDED))
        if not (due.any() or steps.any()):
            return np.zeros(0, TRANSITION), []
        seen = dict(zip(AGENTS, observe(state), strict=True))
        completed = self._complete(np.flatnonzero(due), state, assessment.curvttc, seen)
        if steps.any():
            slots = np.flatnonzero(steps)
            rows = np.zeros(len(slots), TRANSITION)
            for name in ("scenario", "episode", "vehicle_goal", "pedestrian_goal"):
                rows[name] = state[name][slots]
            rows["step"], rows["curvttc"] = self._histories.step[slots], assessment.curvttc[slots]
            rows["acting"] = acts[slots]
            rows["vehicle_policy_version"], rows["pedestrian_policy_version"] = vehicle_version, pedestrian_version
            road = road_of(state[slots], self._tables, self._settings)
            for name, values in zip(_ROAD, road, strict=True):
                rows[name] = values
            for index, (agent, action) in enumerate(zip(AGENTS, (actions.vehicle, actions.pedestrian), strict=True)):
                rows[f"{agent}_observation"] = seen[agent][slots]
                rows[f"{agent}_came"] = self._histories.done[index, slots]
                if action is not None:
                    rows[f"{agent}_action"] = np.asarray(action)[slots]
            self._store(slots, rows)
        return completed

    def _store(self, slots: NDArray[np.int64], rows: NDArray[np.void]) -> None:
        """Append begun transitions to the histories of their slots."""
        place = rows["step"].astype(np.int64)
        if place.max() >= self._steps.shape[1]:
            self._steps = np.concatenate([self._steps, np.zeros_like(self._steps)], axis=1)
        self._steps[slots, place] = rows
        self._begun[slots], self._open[slots] = place + 1, True

    def _complete(
        self,
        slots: NDArray[np.int64],
        state: NDArray[np.void],
        curvttc: NDArray[np.float64],
        seen: dict[str, NDArray[np.float32]],
    ) -> Completed:
        """Complete the open transitions of `slots` with the present state; return them, and the histories that end.

        :param state, curvttc, seen: EPISODE[B], float64[B] [s] and agent -> float32[B, 6], as they are now.
        """
        rows, now = self._steps[slots, self._begun[slots] - 1], state[slots]
        self._open[slots] = False
        rows["number"] = self.count + np.arange(len(rows), dtype=np.uint64)
        self.count += len(rows)
        rows["last"] = ended = now["status"] == ENDED
        rows["next_curvttc"] = np.where(ended, curvttc[slots], 0.0)
        rows["collision"] = ended & (now["outcome"] == COLLISION)
        rows["terminal"] = ended & np.isin(now["outcome"], (COLLISION, GOAL, PARKED_COLLISION))
        for index, agent in enumerate(AGENTS):
            rows[f"next_{agent}_observation"] = np.where(ended[:, None], seen[agent][slots], 0.0)
            rows[f"{agent}_goal"] = (now[f"{agent}_goal"] != 0) & (rows[f"{agent}_goal"] == 0)
            driven = rows["acting"][:, None] == 0
            rows[f"{agent}_action"] = np.where(driven, self._histories.done[index, slots], rows[f"{agent}_action"])
        self._steps[slots, self._begun[slots] - 1] = rows
        histories = [self._steps[slot, : self._begun[slot]].copy() for slot in slots[ended]]
        self._begun[slots[ended]] = 0
        return rows, histories
