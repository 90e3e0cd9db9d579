"""The agents `people`: from a world state to an action by a bank's reactions."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.policy.bank import SITUATION, Reactions, situations_in
from vpsci_ros.policy.choice import ReactionReplay
from vpsci_ros.policy.draws import keys_of
from vpsci_ros.policy.onset_range import beyond, onsets_of
from vpsci_ros.world.tick import Assessment, Tick


class PeopleAtWork:
    """Replays recorded reactions for one agent over B slots, see `vpsci_ros.policy.choice`.

    :param agent: index in `AGENTS`.
    """

    def __init__(self, reactions: Reactions, agent: int, capacity: int) -> None:
        self._replay, self._agent = ReactionReplay(reactions, agent, capacity, keeps_lane=True), agent
        self._situations = np.zeros((capacity, SITUATION))
        self._reach, self._beyond = reactions.reach, np.zeros(capacity, np.bool_)  # at the last hand-over of each slot

    def act(self, tick: Tick, assessment: Assessment, seed: ArrayLike) -> NDArray[np.float32]:
        """Return accelerations [m/s2], float32[B, 2], see `PolicyAgent.act`.

        The vehicle keeps its lane (lateral acceleration 0): the reaction was recorded on another road.
        """
        active = assessment.acting
        situations_in(tick.state, active, self._situations)
        reset = active & (tick.state["controlled"] == 0)
        if np.count_nonzero(reset):
            self._beyond[reset] = beyond(onsets_of(self._situations[reset]), self._reach)
        action = self._replay.step(self._situations, keys_of(tick.state, seed), reset, active).astype(np.float32)
        if self._agent == 0:
            action[:, 1] = 0.0
        return action

    def recorded(self, slot: int) -> int:
        """Return the number of the recorded situation whose reaction acts in a slot; -1: none yet."""
        return int(self._replay.slots["situation"][slot]) - 1

    def beyond(self, slot: int) -> bool | None:
        """Return whether a slot's last hand-over was beyond the range of the recorded onsets; None: none yet."""
        return bool(self._beyond[slot]) if self.recorded(slot) >= 0 else None
