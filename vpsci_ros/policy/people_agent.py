"""The agents `people`: from a world state to an action by a bank's reactions."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.policy.bank import Reactions, situations_in
from vpsci_ros.policy.choice import ReactionReplay
from vpsci_ros.policy.draws import keys_of
from vpsci_ros.policy.forecast import SITUATION
from vpsci_ros.policy.onset_range import beyond, onsets_of
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.observation import STEP
from vpsci_ros.world.tick import Assessment, Tick

HARDEST = 5.0  # [m/s2] a greater acceleration is no pedestrian's: another one was there, or the engine moved it


class PeopleAtWork:
    """Replays recorded reactions for one agent over B slots, see `vpsci_ros.policy.choice`.

    :param agent: index in `AGENTS`.
    """

    def __init__(self, reactions: Reactions, agent: int, capacity: int) -> None:
        self._replay, self._agent = ReactionReplay(reactions, agent, capacity, keeps_lane=True), agent
        self._situations = np.zeros((capacity, SITUATION))
        self._last, self._walked = np.full((capacity, 6), -1.0), np.full((capacity, 2), np.nan)
        self._reach, self._beyond = reactions.reach, np.zeros(capacity, np.bool_)  # at the last hand-over of each slot

    def act(self, tick: Tick, assessment: Assessment, seed: ArrayLike) -> NDArray[np.float32]:
        """Return accelerations [m/s2], float32[B, 2], see `PolicyAgent.act`.

        The vehicle keeps its lane (lateral acceleration 0): the reaction was recorded on another road.
        """
        active = assessment.acting
        walked_in(tick.state, tick.policy_frame, self._last, self._walked)
        if not np.count_nonzero(active):
            return np.zeros((len(active), 2), np.float32)
        situations_in(tick.state, active, self._walked, self._situations)
        reset = active & (tick.state["controlled"] == 0)
        if np.count_nonzero(reset):
            self._beyond[reset] = beyond(onsets_of(self._situations[reset]), self._reach)
        action = self._replay.step(self._situations, keys_of(tick.state, seed), reset, active).astype(np.float32)
        if self._agent == 0:
            action[:, 1] = 0.0
        return action

    def recorded(self, slot: int) -> int:
        """Return the number of the recorded situation whose reaction acts in a slot; -1: none yet."""
        return int(self._replay.slots["situation"][slot, self._agent]) - 1

    def beyond(self, slot: int) -> bool | None:
        """Return whether a slot's last hand-over was beyond the range of the recorded onsets; None: none yet."""
        return bool(self._beyond[slot]) if self.recorded(slot) >= 0 else None


@kernel
def walked_in(state, on_frame, last, out):  # type: ignore[no-untyped-def]
    """Write the pedestrians' accelerations since the last policy frame, east and north [m/s2], to float64[B, 2].

    They are NaN where they are not known: at the first frame of an episode, and above `HARDEST`.

    :param state: EPISODE[B]; on_frame: bool[B], where it is a policy frame.
    :param last: float64[B, 6], scenario, episode, pedestrian, frame and velocity at that frame, which this updates.
    """
    for i in range(state.size):
        if on_frame[i]:
            slot, was = state[i], last[i]
            same = was[0] == slot.scenario and was[1] == slot.episode and was[2] == slot.pedestrian
            ax, ay = (slot.pedestrian_vx - was[4]) / STEP, (slot.pedestrian_vy - was[5]) / STEP
            known = same and was[3] < slot.frame and ax * ax + ay * ay <= HARDEST * HARDEST
            out[i, 0], out[i, 1] = (ax, ay) if known else (np.nan, np.nan)
            was[0], was[1], was[2], was[3] = slot.scenario, slot.episode, slot.pedestrian, slot.frame
            was[4], was[5] = slot.pedestrian_vx, slot.pedestrian_vy
