"""Small networks and small data for the tests of learning."""

import numpy as np
import pytest
import torch

from vpsci_ros.data.synthetic import synthetic_near_misses
from vpsci_ros.learning.config import AGENTS, NetworkConfig
from vpsci_ros.learning.networks import Networks

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, actor_hidden=[8, 8], critic_hidden=[8, 8])


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def near_misses():
    return synthetic_near_misses(interactions=16, seed=3).table


@pytest.fixture(scope="session")
def networks():
    """Return the function that makes networks whose actors act strongly, with a normalisation that does something."""
    return _networks


def _networks(config: NetworkConfig = SMALL, seed: int = 0, gain: float = 200.0) -> Networks:
    torch.manual_seed(seed)
    made = Networks(config)
    rng = np.random.default_rng(seed)
    made.set_statistics(
        {agent: rng.normal(1.0, 2.0, (50, 6)).astype(np.float32) for agent in AGENTS},
        {agent: rng.normal(0.0, 1.0, (50, 2)).astype(np.float32) for agent in AGENTS},
        0.3,
    )
    with torch.no_grad():
        for agent in AGENTS:
            made.actor[agent].head[-1].weight.mul_(gain)
    return made
