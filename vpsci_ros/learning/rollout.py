"""Episodes in process: world, monitor and policies called in turn, exactly as the graph of nodes calls them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.learning.agent import PolicyAgent
from vpsci_ros.learning.config import AGENTS, RefineConfig
from vpsci_ros.learning.weights import Weights
from vpsci_ros.world import World, handover
from vpsci_ros.world.monitor import MonitorConfig, assess


class Acting(Protocol):
    """Whatever answers a world's state with the accelerations of one agent, as `PolicyAgent` does."""

    def act(
        self,
        state: NDArray[np.void],
        policy_frame: NDArray[np.bool_],
        curvttc: NDArray[np.float64],
        critical: NDArray[np.bool_],
    ) -> NDArray[np.float32]:
        """See `PolicyAgent.act`."""


@dataclass(frozen=True)
class Tick:
    """All that happened at one tick: what was published, what was answered, what came of it.

    state: EPISODE[B] at `tick` (the world's own array, valid until the next tick is asked for); curvttc [s] and
    distance [m]: float64[B]; critical: bool[B]; actions: float64[B, 2] per agent [m/s2], None where not asked for;
    events: EVENT[n] of the step to the next tick.
    """

    tick: int
    state: NDArray[np.void]
    curvttc: NDArray[np.float64]
    distance: NDArray[np.float64]
    critical: NDArray[np.bool_]
    actions: dict[str, NDArray[np.float64] | None]
    events: NDArray[np.void]


def policies(
    weights: Weights, world: World, seed: int, explore: bool, noise: RefineConfig | None = None
) -> dict[str, PolicyAgent]:
    """Return the learned policies, see `PolicyAgent`, of those agents that the world's configuration hands to one."""
    agents = {}
    for agent in AGENTS:
        if getattr(world.config, f"{agent}_driver") == "policy":
            agents[agent] = PolicyAgent(agent, seed, explore, noise)
            agents[agent].load(weights, version=1)
    return agents


def rollout(world: World, monitor: MonitorConfig, agents: Mapping[str, Acting]) -> Iterator[Tick]:
    """Run a world until its queue of episodes is done, yielding every tick."""
    while not world.done:
        tick, state = world.tick, world.state.copy()
        curvttc, distance, critical = assess(state, monitor)
        frame = handover.policy_frame(state, world.config)
        actions: dict[str, NDArray[np.float64] | None] = dict.fromkeys(AGENTS)
        if frame.any():
            for agent, policy in agents.items():
                actions[agent] = policy.act(state, frame, curvttc, critical).astype(np.float64)
        events = world.advance(curvttc, critical, actions["vehicle"], actions["pedestrian"])
        yield Tick(tick, state, curvttc, distance, critical, actions, events)
