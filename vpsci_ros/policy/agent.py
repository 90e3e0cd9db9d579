"""One agent at work: what a policy does between a world state and an action, in process and in its node alike."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.policy.config import NoiseConfig, PolicyConfig
from vpsci_ros.policy.draws import Keys, draw_innovation, draw_latent, keys_of
from vpsci_ros.policy.exploration import exploration_noise
from vpsci_ros.policy.residuals import Borrower, Residuals, moments_in, same
from vpsci_ros.policy.stepped import SteppedActor, actor_at_work
from vpsci_ros.policy.streaming import Draws, StreamingActor
from vpsci_ros.policy.weights import ActorWeights, Weights
from vpsci_ros.world import EPISODE, RUNNING, World, observation
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.sharing import leading_rows
from vpsci_ros.world.tick import Assessment, Tick


class PolicyAgent:
    """The actor of one agent over a batch of parallel episodes, each with its own history since the hand-over.

    Of several pedestrians in an episode each has its own draws and history. Their vehicle has a history with each of
    them, and acts in all rows as it does where CurvTTC is least, see `vpsci_ros.world.sharing.leading_rows`.

    Call `load` before `act`.

    :param agent: "vehicle" or "pedestrian".
    :param seed: of the exploration noise and of what a stochastic policy draws.
    :param explore: add the noise of equation (16), a function of (seed, scenario, episode, step) only.
    :param noise: how much; None: the defaults.
    :param temperature: factor on what a stochastic policy draws (`vpsci_ros.policy.draws`); 1: as learned, 0: the
        deterministic middle. A policy without latent numbers or residuals draws nothing.
    :param people: the source whose residuals act; empty: the first one's.
    """

    def __init__(
        self,
        agent: str,
        seed: int,
        explore: bool,
        noise: NoiseConfig | None = None,
        temperature: float = 1.0,
        people: str = "",
    ) -> None:
        self._index = AGENTS.index(agent)
        self._seed: int | NDArray[np.int64] = seed
        self._explore = explore
        self._noise = noise or NoiseConfig()
        self._temperature, self._people = temperature, people
        self._residuals: Residuals | None = None
        self._source = 0
        self._borrower: Borrower | None = None
        self._weights: ActorWeights | None = None
        self._actor: StreamingActor | SteppedActor | None = None
        self._step = np.zeros(0, np.int64)
        self._latent = np.zeros((0, 0), np.float32)
        self.version = 0

    def load(self, weights: Weights, version: int) -> None:
        """Act with `weights` from the next step on; histories are kept.

        The first call takes seconds where the kernels are not compiled yet, so that no step has to.
        """
        first = self._weights is None
        self._weights, residuals = weights.actor(AGENTS[self._index]), weights.residuals()
        if not same(residuals, self._residuals):
            self._residuals, self._borrower = residuals, None  # others' from the next step on
        self._source = weights.people(self._people)
        self.version = version
        if first:
            self._warm_up(weights)
        if self._actor is not None:
            self._actor.load(self._weights)

    def set_exploration(self, explore: bool, noise: NoiseConfig) -> None:
        """Explore, or no longer, by this noise from the next step on."""
        self._explore, self._noise = explore, noise

    def set_seeds(self, seeds: NDArray[np.int64]) -> None:
        """Draw by a seed of its own in each slot, int64[B], from the next step on."""
        self._seed = seeds

    def set_temperature(self, temperature: float) -> None:
        """Draw by this temperature from the next step on."""
        self._temperature = temperature

    def act(self, tick: Tick, assessment: Assessment) -> NDArray[np.float32]:
        """Return accelerations [m/s2], float32[B, 2] as (longitudinal, lateral); 0 where the policy does not act."""
        assert self._weights is not None, "act() before load()"
        state, active = tick.state, assessment.acting
        if self._actor is None or len(self._step) != len(state):
            self._actor = actor_at_work(self._weights, len(state))
            self._step = np.zeros(len(state), np.int64)
            self._latent = np.zeros((len(state), self._weights.network.latent), np.float32)
            self._borrower = None
        if self._residuals is not None and self._borrower is None:
            self._borrower = Borrower(self._residuals, self._index, len(state), self._source)
        if not np.count_nonzero(active):
            return np.zeros((len(state), 2), np.float32)
        reset = active & (state["controlled"] == 0)
        self._step += active
        self._step[reset] = 0
        key = keys_of(state, self._seed)
        draws = self._draws(key, reset, active)
        seen = observation.observe(state, active)
        residual = None
        if self._borrower is not None:
            moment = moments_in(state, seen[0])  # by which both find the same person
            residual = self._borrower.step(moment, key, reset, active) * np.float32(self._temperature)
        action = self._actor.step(seen[self._index], assessment.curvttc, reset, active, draws, residual)
        if self._explore:
            which = state["scenario"], state["episode"], self._step
            limit = self._weights.network.action_limit
            noise = exploration_noise(self._seed, *which, self._index, self._noise, limit)
            action = np.where(active[:, None], np.clip(action + noise, -limit, limit), 0).astype(np.float32)
            self._actor.executed(action, active)
        if self._index == 0 and np.count_nonzero(state["pedestrian"]):
            leaders = leading_rows(state, active, assessment.curvttc)
            action = np.where(active[:, None], action[leaders], np.float32(0))
            self._actor.executed(action, active)
        if self._index == 0 and self._borrower is not None:
            action[:, 1] = 0.0  # the road turns another way than the one on which it was learned: the lane is kept
            self._actor.executed(action, active)
        return action

    def drawn(self, slot: int) -> tuple[NDArray[np.float32], int]:
        """Return who acts in a slot: its latent numbers, float32[latent], and the recorded sequence; -1: none.

        Both are drawn at the hand-over, see `vpsci_ros.policy.draws` and `vpsci_ros.policy.residuals.Borrower`.
        """
        latent = self._latent[slot].copy() if len(self._latent) else np.zeros(0, np.float32)
        return latent, -1 if self._borrower is None else self._borrower.sequence(slot)

    def _warm_up(self, weights: Weights) -> None:
        """Have another one act and explore, in episodes of nobody's: in one, whose columns lie close, and in two."""
        trial = PolicyAgent(AGENTS[self._index], 0, explore=True)
        trial._weights, trial._residuals = weights.actor(AGENTS[self._index]), weights.residuals()
        for rows in (1, 2):
            state, near, every = np.zeros(rows, EPISODE), np.ones(rows), np.ones(rows, np.bool_)
            state["status"], state["pedestrian"] = RUNNING, np.arange(rows)
            tick = Tick(0, state, every)
            trial.act(tick, tick.assessed(near, near, every))

    def _draws(self, key: Keys, reset: NDArray[np.bool_], active: NDArray[np.bool_]) -> Draws | None:
        """Return what the active episodes draw for this step, or None where nothing is drawn."""
        size = self._latent.shape[1]
        if size == 0:
            return None
        if self._index == 0:
            key = key.copy()
            key[:, 3] = 0  # the driver is the same to all
        if np.count_nonzero(reset):
            seed, scenario, episode, person, _ = key[reset].T
            self._latent[reset] = draw_latent(seed, scenario, episode, self._index, size, person)
        return Draws(self._latent, draw_innovation(key, self._index, active), np.float32(self._temperature))


def learned_agent(agent: str, config: PolicyConfig) -> PolicyAgent:
    """Return the policy of "vehicle" or "pedestrian" by the parameters of its node, without weights yet."""
    return PolicyAgent(agent, config.seed, config.explore, config.noise, config.temperature, config.people)


def policies(
    weights: Weights, world: World, configs: Mapping[str, PolicyConfig] | None = None
) -> dict[str, PolicyAgent]:
    """Return the learned policies of those agents that the world's configuration hands to one.

    :param configs: agent -> how it explores and draws; without one it does not explore, and draws by the world's seed.
    """
    agents = {}
    for agent in AGENTS:
        if getattr(world.config, f"{agent}_driver") == "policy":
            config = (configs or {}).get(agent, PolicyConfig(seed=world.seed))
            agents[agent] = learned_agent(agent, config)
            agents[agent].load(weights, version=1)
    return agents
