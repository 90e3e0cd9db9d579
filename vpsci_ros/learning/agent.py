"""One agent at work: what a policy does between a world state and an action, in process and in its node alike."""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.learning.config import AGENTS, RefineConfig
from vpsci_ros.learning.exploration import exploration_noise
from vpsci_ros.learning.streaming import StreamingActor
from vpsci_ros.learning.weights import ActorWeights, Weights
from vpsci_ros.world import handover, observation


class PolicyAgent:
    """The actor of one agent over a batch of parallel episodes, each with its own history since the hand-over.

    Call `load` before `act`.

    :param agent: "vehicle" or "pedestrian".
    :param seed: of the exploration noise.
    :param explore: add the noise of equation (16), a function of (seed, scenario, episode, step) only.
    :param noise: whose `noise_...` fields say how much; None: the defaults.
    """

    def __init__(self, agent: str, seed: int, explore: bool, noise: RefineConfig | None = None) -> None:
        self._index = AGENTS.index(agent)
        self._seed = seed
        self._explore = explore
        self._noise = noise or RefineConfig()
        self._weights: ActorWeights | None = None
        self._actor: StreamingActor | None = None
        self._step = np.zeros(0, np.int64)
        self.version = 0

    def load(self, weights: Weights, version: int) -> None:
        """Act with `weights` from the next step on; histories are kept.

        The first call takes seconds where the kernels are not compiled yet, so that no step has to.
        """
        first = self._weights is None
        self._weights = weights.actor(AGENTS[self._index])
        self.version = version
        if first:
            none, once = np.zeros((1, 6), np.float32), np.ones(1, bool)
            StreamingActor(self._weights, 1).step(none, np.full(1, np.inf), once, once)
        if self._actor is not None:
            self._actor.load(self._weights)

    def set_exploration(self, explore: bool, noise: RefineConfig) -> None:
        """Explore, or no longer, by this noise from the next step on."""
        self._explore, self._noise = explore, noise

    def act(
        self,
        state: NDArray[np.void],
        policy_frame: NDArray[np.bool_],
        curvttc: NDArray[np.float64],
        critical: NDArray[np.bool_],
    ) -> NDArray[np.float32]:
        """Return accelerations [m/s2], float32[B, 2] as (longitudinal, lateral); 0 where the policy does not act.

        :param state: EPISODE[B]; policy_frame, critical: bool[B]; curvttc: float64[B] [s].
        """
        assert self._weights is not None, "act() before load()"
        if self._actor is None or len(self._step) != len(state):
            self._actor = StreamingActor(self._weights, len(state))
            self._step = np.zeros(len(state), np.int64)
        active = handover.acting(state, policy_frame, critical)
        if not active.any():
            return np.zeros((len(state), 2), np.float32)
        reset = active & (state["controlled"] == 0)
        self._step = np.where(reset, 0, self._step + active)
        action = self._actor.step(observation.observe(state)[self._index], curvttc, reset, active)
        if self._explore:
            which = state["scenario"], state["episode"], self._step
            limit = self._weights.network.action_limit
            noise = exploration_noise(self._seed, *which, self._index, self._noise, limit)
            action = np.where(active[:, None], np.clip(action + noise, -limit, limit), 0).astype(np.float32)
            self._actor.executed(action, active)
        return action
