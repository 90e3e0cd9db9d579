"""The policy of one agent, from a world state to an action, used by the loop in one process and by a node.

A policy is a bank of recorded reactions (`vpsci_ros.policy.bank`), or the networks of a weights file.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.exploration import exploration_noise
from vpsci_ros.policy.histories import Histories
from vpsci_ros.policy.people_agent import PeopleAtWork
from vpsci_ros.policy.policy_config import NoiseConfig, PolicyConfig
from vpsci_ros.policy.policy_file import Policy, require_source
from vpsci_ros.policy.stepped import actor_at_work
from vpsci_ros.policy.weights import Weights
from vpsci_ros.world import EPISODE, RUNNING, World, observation
from vpsci_ros.world.crowd import leading_rows
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import Assessment, Tick


class PolicyAgent:
    """The policy of one agent over a batch of parallel episodes.

    Several pedestrians in an episode act independently. Their vehicle has a history with each of them, and acts in all
    rows as in the row with the least CurvTTC, see `vpsci_ros.world.crowd.leading_rows`.

    Call `load` before `act`.

    :param agent: "vehicle" or "pedestrian".
    :param seed: of the exploration noise and of the choice of reactions.
    :param explore: networks: add the noise of equation (16), a function of (seed, scenario, episode, step) only.
    :param noise: amplitude of the noise; None: the defaults.
    :param people: source in a bank whose reactions are replayed; empty: the first source.
    """

    def __init__(
        self, agent: str, seed: int, explore: bool, noise: NoiseConfig | None = None, people: str = ""
    ) -> None:
        self._index = AGENTS.index(agent)
        self._seed: int | NDArray[np.int64] = seed
        self._explore, self._noise = explore, noise or NoiseConfig()
        self._people = people
        self._policy: Policy | None = None
        self._work: PeopleAtWork | NetworkAtWork | None = None
        self._rows = 0
        self.version = 0

    def load(self, policy: Policy, version: int) -> None:
        """Use `policy` from the next step on; histories of networks of the same shape continue.

        The first call takes seconds where the kernels are not compiled yet, so that no step has to.

        :raises InvalidInput: a bank without the source `people`, networks although a source is named, or, where SST
            networks act, networks of another shape.
        :raises RuntimeError: where other networks act, networks of another shape (torch's error).
        """
        require_source(policy, self._people)
        first, same = self._policy is None, isinstance(policy, Weights) and isinstance(self._work, NetworkAtWork)
        self._policy, self.version = policy, version
        if first:
            self._warm_up(policy)
        if same:
            self._work.load(policy.actor(AGENTS[self._index]))  # type: ignore[union-attr]
        else:
            self._work = None

    def set_seeds(self, seeds: NDArray[np.int64]) -> None:
        """Set the seed of each slot, int64[B], from the next step on."""
        self._seed = seeds

    def act(self, tick: Tick, assessment: Assessment) -> NDArray[np.float32]:
        """Return accelerations [m/s2], float32[B, 2] as (longitudinal, lateral); 0 where the policy does not act.

        Call `act` at every policy frame, also where no row acts: histories continue.
        """
        assert self._policy is not None, "act() before load()"
        state, active = tick.state, assessment.acting
        if self._work is None or self._rows != len(state):
            self._work, self._rows = self._at_work(self._policy, len(state)), len(state)
        if isinstance(self._work, NetworkAtWork):
            action = self._work.act(tick, assessment, self._seed, self._noise if self._explore else None)
        else:
            action = self._work.act(tick, assessment, self._seed)
        if self._index == 0 and np.count_nonzero(state["pedestrian"]) and np.count_nonzero(active):
            leaders = leading_rows(state, active, assessment.curvttc)
            action = np.where(active[:, None], action[leaders], np.float32(0))
            if isinstance(self._work, NetworkAtWork):
                self._work.executed(action, active)
        return action

    def recorded(self, slot: int) -> int:
        """Return the number of the recorded situation whose reaction acts in a slot; -1: none, or a network acts."""
        return self._work.recorded(slot) if isinstance(self._work, PeopleAtWork) else -1

    def beyond(self, slot: int) -> bool | None:
        """Return whether a slot's last hand-over was beyond the source's range; None: no bank, or no hand-over yet."""
        return self._work.beyond(slot) if isinstance(self._work, PeopleAtWork) else None

    @property
    def keeps_lane(self) -> bool:
        """Whether this agent drives without steering, so that the world keeps its lane: a bank's vehicle does."""
        return self._index == 0 and isinstance(self._policy, Bank)

    @property
    def reach(self) -> NDArray[np.float64] | None:
        """The range of the acting source, float64[4, 5], see `onset_range`; None: a network, or no policy yet."""
        return self._policy.of(self._people).reach if isinstance(self._policy, Bank) else None

    def _at_work(self, policy: Policy, rows: int) -> "PeopleAtWork | NetworkAtWork":
        if isinstance(policy, Bank):
            return PeopleAtWork(policy.of(self._people), self._index, rows)
        return NetworkAtWork(policy.actor(AGENTS[self._index]), self._index, rows)

    def _warm_up(self, policy: Policy) -> None:
        """Run a copy of the policy with exploration in slots without an episode: one, and two that share a vehicle."""
        trial = PolicyAgent(AGENTS[self._index], 0, explore=True, people=self._people)
        trial._policy = policy
        for rows in (1, 2):
            state, near, every = np.zeros(rows, EPISODE), np.ones(rows), np.ones(rows, np.bool_)
            state["status"], state["pedestrian"] = RUNNING, np.arange(rows)
            tick = Tick(0, state, every)
            trial.act(tick, tick.assessed(near, near, every))


class NetworkAtWork:
    """The actor of one agent over B slots, each with its own history, see `vpsci_ros.policy.histories`.

    :param agent: index in `AGENTS`.
    """

    def __init__(self, weights: Weights, agent: int, capacity: int) -> None:
        self._agent, self._limit = agent, weights.network.action_limit
        self._actor = actor_at_work(weights, capacity)
        self._histories = Histories(capacity)

    def load(self, weights: Weights) -> None:
        """Use other weights of the same shape from the next step on."""
        self._actor.load(weights)

    def act(
        self, tick: Tick, assessment: Assessment, seed: ArrayLike, explore: NoiseConfig | None
    ) -> NDArray[np.float32]:
        """Return accelerations [m/s2], float32[B, 2], see `PolicyAgent.act`.

        :param explore: the noise of (16); None: none.
        """
        state, active = tick.state, assessment.acting
        begins, _ = self._histories.take(state, tick.policy_frame, active)
        if not np.count_nonzero(active):
            return np.zeros((len(state), 2), np.float32)
        self._actor.executed(self._histories.done[self._agent], begins)
        seen = observation.observe(state, active)[self._agent]
        action = self._actor.step(seen, assessment.curvttc, begins, active)
        if explore is not None:
            which = state["scenario"], state["episode"], self._histories.step
            noise = exploration_noise(seed, *which, self._agent, explore, self._limit)
            action = np.clip(action + noise, -self._limit, self._limit)
        action = np.where(active[:, None], action, 0).astype(np.float32)
        self._actor.executed(action, active)
        return action

    def executed(self, action: NDArray[np.float32], active: NDArray[np.bool_]) -> None:
        """Append the executed actions to the histories where `active`."""
        self._actor.executed(action, active)


def learned_agent(agent: str, config: PolicyConfig) -> PolicyAgent:
    """Return the policy of "vehicle" or "pedestrian" by the parameters of its node, without weights yet."""
    return PolicyAgent(agent, config.seed, config.explore, config.noise, config.people)


def policies(policy: Policy, world: World, configs: Mapping[str, PolicyConfig] | None = None) -> dict[str, PolicyAgent]:
    """Return agent -> its policy, for each agent whose driver in the world's configuration is `policy`.

    :param configs: agent -> how it explores and draws; without one it does not explore, and draws by the world's seed.
    """
    agents = {}
    for agent in AGENTS:
        if getattr(world.config, f"{agent}_driver") == "policy":
            config = (configs or {}).get(agent, PolicyConfig(seed=world.seed))
            agents[agent] = learned_agent(agent, config)
            agents[agent].load(policy, version=1)
    return agents
