"""A policy at work: explores as its parameters say, and never beyond the limit of an action."""

import subprocess
import sys

import numpy as np
import pytest

from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.config import NetworkConfig, NoiseConfig
from vpsci_ros.policy.weights import Weights
from vpsci_ros.world import EPISODE, RUNNING
from vpsci_ros.world.tick import Tick

SLOTS = 64


@pytest.fixture(scope="module")
def weights() -> Weights:
    return Networks(NetworkConfig()).weights({}, {})


def first_actions(weights: Weights, noise: NoiseConfig | None) -> np.ndarray:
    """Actions, float32[SLOTS, 2], of the first step after a hand-over in episodes 0, 1, ...; None: no exploration."""
    agent = PolicyAgent("vehicle", 1, explore=noise is not None, noise=noise)
    agent.load(weights, version=1)
    state = np.zeros(SLOTS, EPISODE)
    state["status"], state["scenario"], state["episode"] = RUNNING, 1, np.arange(SLOTS)
    state["vehicle_speed"], state["pedestrian_x"] = 3.0, 5.0
    every, near = np.ones(SLOTS, bool), np.full(SLOTS, 2.0)
    tick = Tick(number=0, state=state, policy_frame=every)
    return agent.act(tick, tick.assessed(near, near, every))


def test_the_noise_that_is_added_is_the_noise_that_is_set(weights: Weights) -> None:
    plain = first_actions(weights, None)
    none = first_actions(weights, NoiseConfig(start=0.0, floor=0.0))
    little = first_actions(weights, NoiseConfig(start=0.0, floor=0.02))
    twice = first_actions(weights, NoiseConfig(start=0.0, floor=0.04))
    assert none.tobytes() == plain.tobytes()
    np.testing.assert_allclose(twice - plain, 2 * (little - plain), atol=1e-5)
    assert np.std(little - plain) > 0.01


def test_an_exploring_action_stays_within_the_limit(weights: Weights) -> None:
    wild = first_actions(weights, NoiseConfig(start=2.0, floor=2.0))
    assert np.abs(wild).max() == NetworkConfig().action_limit


COMPILED = """
import gc, sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.world import EPISODE, RUNNING
from vpsci_ros.world.tick import Tick

def compiled():
    kernels = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {(each.py_func.__qualname__, str(kind)) for each in kernels for kind in each.signatures}

agents = []
for policy in map(load_policy, ("people", "ma_sst_ddpg")):
    for agent in ("vehicle", "pedestrian"):
        agents.append(PolicyAgent(agent, 1, explore=True))
        agents[-1].load(policy, 1)
before = compiled()
assert len(before) > 5
for rows in (1, 16):
    state, near, every = np.zeros(rows, EPISODE), np.ones(rows), np.ones(rows, bool)
    state["status"], state["pedestrian"] = RUNNING, np.arange(rows) % 2
    for step in range(2):
        tick = Tick(step, state, every)
        for agent in agents:
            agent.act(tick, tick.assessed(near, near, every))
        state["controlled"] = 1
print(sorted(compiled() - before))
"""


def test_a_policy_compiles_nothing_at_a_step_so_that_none_takes_seconds_where_it_is_new() -> None:
    done = subprocess.run([sys.executable, "-c", COMPILED], capture_output=True, text=True, timeout=200, check=False)
    assert (done.stdout, done.stderr) == ("[]\n", "")
