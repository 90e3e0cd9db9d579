"""The kinds of agents: the policy by a bank or weights, and agents that other installed Python packages add."""

from collections.abc import Callable
from dataclasses import dataclass

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.agent import learned_agent
from vpsci_ros.policy.policy_config import LEARNED, PolicyConfig
from vpsci_ros.runs.plugins import PluginGroup
from vpsci_ros.world.loop import Agent
from vpsci_ros.world.observation import AGENTS


@dataclass(frozen=True)
class AgentType:
    """A kind of agent: the function that makes one, and the agents that it can be; see docs/extending.md.

    :ivar make: returns the agent, given "vehicle" or "pedestrian" and the parameters of that agent's node.
    :ivar agents: "vehicle", "pedestrian" or both: the agents that `make` accepts.
    """

    make: Callable[[str, PolicyConfig], Agent]
    agents: tuple[str, ...] = AGENTS


AGENT_TYPES = PluginGroup("vpsci_ros.agents", "agent", AgentType, {LEARNED: AgentType(learned_agent)})


def make_agent(agent: str, config: PolicyConfig) -> Agent:
    """Return the agent for "vehicle" or "pedestrian"; a policy has no weights yet, see `PolicyAgent.load`.

    :raises InvalidInput: no kind of agent is called `config.agent`, the package that adds it is broken, or the kind
        cannot be this agent.
    """
    kind = AGENT_TYPES.find(config.agent)
    if agent not in kind.agents:
        raise InvalidInput(f"{agent}_policy.agent = {config.agent}: this one can only be {' or '.join(kind.agents)}")
    return kind.make(agent, config)
