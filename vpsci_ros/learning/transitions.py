"""Experience for the learner: one record per policy step, made from successive states of a world."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.observation import ACTION_SIZE, AGENTS, OBSERVATION_SIZE, observe
from vpsci_ros.world.state import COLLISION, ENDED, GOAL, PARKED_COLLISION
from vpsci_ros.world.tick import Step

# Fields as in vpsci_msgs/Transition, which says what each one holds; `number` counts transitions without gaps. What the
# step after sees is zero but in the last transition of a history: elsewhere it is in the next transition.
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
        ("collision", "u1"),
        ("vehicle_goal", "u1"),
        ("pedestrian_goal", "u1"),
        ("last", "u1"),
        ("terminal", "u1"),
        ("vehicle_policy_version", "u4"),
        ("pedestrian_policy_version", "u4"),
    ]
)


STEPS = 128  # of a history, before its memory doubles
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


class Completed(NamedTuple):
    """What a tick completed.

    :ivar transitions: TRANSITION[n], in the order of the episodes' slots.
    :ivar histories: those that end with one of these, whole, TRANSITION[T] each.
    """

    transitions: NDArray[np.void]
    histories: list[NDArray[np.void]]


class TransitionBuilder:
    """Pairs the state of each policy frame with the state one policy period, or the end of the episode, later.

    Call `observe` at every tick, in order. Steps without an answer of both policies make no transition and end the
    history: what the rule-based pair does in their place is not the policies' experience.

    :param credit_outcome: where control was given back, the last transition is complete only when the policies take
        over again or the episode ends, and says which goals were reached by then, and how it ended: what the rule-based
        pair finishes, the policies have brought about. False: it is complete at once, and goals reached later are
        nobody's.
    :ivar count: transitions completed so far.
    """

    def __init__(self, credit_outcome: bool = False) -> None:
        self._credit_outcome = credit_outcome
        self.count = 0
        self._resize(0)

    def _resize(self, slots: int) -> None:
        self._steps = np.zeros((slots, STEPS), TRANSITION)  # of the history under way in each slot
        self._begun = np.zeros(slots, np.int64)  # how many of them have begun
        self._open = np.zeros(slots, np.bool_)  # the last of them has no next state yet
        self._waiting = np.zeros(slots, np.bool_)  # control was given back, and the outcome is to come

    def clear(self) -> None:
        """Forget what was begun: other episodes begin. Numbers go on."""
        self._open[:], self._waiting[:], self._begun[:] = False, False, 0

    def observe(self, step: Step, vehicle_version: int = 0, pedestrian_version: int = 0) -> Completed:
        """Take one tick in and return what it completes.

        :param step: whose actions are the policies'.
        :param vehicle_version, pedestrian_version: of the weights by which they acted.
        """
        (_, state, policy_frame, _), assessment, actions = step.tick, step.assessment, step.actions
        if len(self._open) != len(state):
            self._resize(len(state))
        both = actions.vehicle is not None and actions.pedestrian is not None
        acts = assessment.acting & both
        ended = state["status"] == ENDED
        due = self._open & (policy_frame | ended)
        known = self._waiting & (ended | acts)
        if not (due.any() or acts.any() or known.any()):
            return Completed(np.zeros(0, TRANSITION), [])
        seen = dict(zip(AGENTS, observe(state), strict=True))
        self._close(state, assessment.curvttc, seen, due, acts)
        completed = self._complete(state, known | due & ~self._waiting)
        if acts.any():
            slots = np.flatnonzero(acts)
            rows = self._begin(state[slots], assessment.curvttc[slots])
            rows["vehicle_policy_version"], rows["pedestrian_policy_version"] = vehicle_version, pedestrian_version
            for agent, action in zip(AGENTS, (actions.vehicle, actions.pedestrian), strict=True):
                rows[f"{agent}_observation"], rows[f"{agent}_action"] = seen[agent][slots], np.asarray(action)[slots]
            self._store(slots, rows)
        return completed

    def _begin(self, state: NDArray[np.void], curvttc: NDArray[np.float64]) -> NDArray[np.void]:
        """Return transitions that begin in states EPISODE[n], all but what the agents see and do."""
        rows = np.zeros(len(state), TRANSITION)
        for name in ("scenario", "episode", "vehicle_goal", "pedestrian_goal"):
            rows[name] = state[name]
        rows["step"] = np.where(state["controlled"] == 0, 0, state["step"])
        rows["curvttc"] = curvttc
        return rows

    def _store(self, slots: NDArray[np.int64], rows: NDArray[np.void]) -> None:
        """Append begun transitions to the histories of their slots."""
        place = np.where(rows["step"] == 0, 0, self._begun[slots])
        if place.max() == self._steps.shape[1]:
            self._steps = np.concatenate([self._steps, np.zeros_like(self._steps)], axis=1)
        self._steps[slots, place] = rows
        self._begun[slots], self._open[slots] = place + 1, True

    def _close(
        self,
        state: NDArray[np.void],
        curvttc: NDArray[np.float64],
        seen: dict[str, NDArray[np.float32]],
        due: NDArray[np.bool_],
        acts: NDArray[np.bool_],
    ) -> None:
        """Give the open transitions of the slots `due`, bool[B], their next state; some then wait for the outcome.

        :param state, curvttc, seen: EPISODE[B], float64[B] [s] and agent -> float32[B, 6], as they are now.
        :param acts: bool[B]: where the policies go on.
        """
        slots = np.flatnonzero(due)
        rows, now = self._steps[slots, self._begun[slots] - 1], state[slots]
        self._open[slots] = False
        going_on = acts[slots] & (now["status"] != ENDED)
        rows["last"] = last = ~going_on | (now["controlled"] == 0)
        rows["next_curvttc"] = np.where(last, curvttc[slots], 0.0)
        for agent in AGENTS:
            rows[f"next_{agent}_observation"] = np.where(last[:, None], seen[agent][slots], 0.0)
        self._steps[slots, self._begun[slots] - 1] = rows
        self._waiting[slots] = self._credit_outcome & ~acts[slots] & (now["status"] != ENDED)

    def _complete(self, state: NDArray[np.void], known: NDArray[np.bool_]) -> Completed:
        """Complete the closed transitions of the slots `known`, bool[B], by what is the case now, EPISODE[B]."""
        slots = np.flatnonzero(known)
        rows, now = self._steps[slots, self._begun[slots] - 1], state[slots]
        self._waiting[slots] = False
        rows["number"] = self.count + np.arange(len(rows), dtype=np.uint64)
        self.count += len(rows)
        ended, last = now["status"] == ENDED, rows["last"] == 1
        rows["collision"] = ended & (now["outcome"] == COLLISION)
        rows["terminal"] = ended & np.isin(now["outcome"], (COLLISION, GOAL, PARKED_COLLISION))
        for agent in AGENTS:
            rows[f"{agent}_goal"] = (now[f"{agent}_goal"] != 0) & (rows[f"{agent}_goal"] == 0)
        self._steps[slots, self._begun[slots] - 1] = rows
        whole = slots[last & (self._steps["step"][slots, 0] == 0)]
        histories = [self._steps[slot, : self._begun[slot]].copy() for slot in whole]
        self._begun[slots[last]] = 0
        return Completed(rows, histories)
