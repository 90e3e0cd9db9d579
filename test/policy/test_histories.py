"""One history an episode, from its first hand-over to its end: the same where a policy acts and where it is learned."""

import numpy as np
import pytest
import torch

from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.transitions import TransitionBuilder
from vpsci_ros.policy.actor import previous
from vpsci_ros.policy.agent import PolicyAgent, policies
from vpsci_ros.policy.config import NetworkConfig, NoiseConfig, PolicyConfig
from vpsci_ros.policy.histories import Histories, motion_of
from vpsci_ros.world import EPISODE, RUNNING, World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import Tick

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8)
PAPER = WorldConfig(spawn="paper", episode_time=10.0, release_time=0.0, lane_following=False)
EPISODES = [(scenario, number) for number in range(3) for scenario in (1, 2, 5, 7)]


@pytest.fixture(scope="module")
def networks() -> Networks:
    torch.manual_seed(5)
    made = Networks(SMALL)
    with torch.no_grad():
        for agent in AGENTS:
            made.actor[agent].head[-1].weight.normal_(0.0, 0.5)
    return made


def histories(networks: Networks, batch: int, explore: bool = False) -> dict[tuple[int, int], np.ndarray]:
    """Simulate; return the transitions of each episode."""
    world, builder = World(PAPER, load_scenarios([1, 2, 5, 7]), EPISODES, batch, 3), TransitionBuilder()
    config = PolicyConfig(explore=explore, seed=4, noise=NoiseConfig(start=0.2))
    agents = policies(networks.weights({}, {}), world, dict.fromkeys(AGENTS, config))
    made = [whole for step in Loop(world, agents=agents) for whole in builder.observe(step).histories]
    return {(int(whole["scenario"][0]), int(whole["episode"][0])): whole for whole in made}


@pytest.fixture(scope="module")
def alone(networks: Networks) -> dict[tuple[int, int], np.ndarray]:
    return histories(networks, 1)


def test_a_policy_acts_by_the_history_that_is_learned_from(networks, alone):
    """What the network says of a whole recorded history is what was done at every step at which it acted."""
    again = 0
    for whole in alone.values():
        acting = whole["acting"] != 0
        again += int((np.diff(acting.astype(int)) == 1).sum())
        for agent in AGENTS:
            seen, done = (torch.from_numpy(whole[f"{agent}_{name}"].copy())[None] for name in ("observation", "action"))
            with torch.no_grad():
                said = networks.actor[agent](seen, previous(done), torch.from_numpy(whole["curvttc"].copy())[None])[0]
            np.testing.assert_allclose(said.numpy()[acting], whole[f"{agent}_action"][acting], atol=1e-4)
    assert again > 3, "the policies were handed over to again, in the same history"


def test_an_episode_has_the_same_history_to_the_bit_in_any_batch(networks, alone):
    together = histories(networks, 8)
    assert set(together) == set(alone)
    for key, whole in alone.items():
        for name in (name for name in whole.dtype.names if name != "number"):
            assert np.array_equal(whole[name], together[key][name]), name


def test_the_noise_of_a_second_stretch_is_not_that_of_the_first(networks):
    """Of two hand-overs in an episode, the first steps once had the same draw of (16)."""
    agents = [PolicyAgent("vehicle", 1, explore, NoiseConfig(start=0.3)) for explore in (True, False)]
    for agent in agents:
        agent.load(networks.weights({}, {}), version=1)
    noise = []
    for frame, acts in enumerate((True, False, True)):
        state, every = np.zeros(1, EPISODE), np.ones(1, bool)
        state["status"], state["frame"], state["pedestrian_x"] = RUNNING, 2 * frame, 9.0
        tick = Tick(frame, state, every)
        first, second = (a.act(tick, tick.assessed([1.0 if acts else 9.0], [9.0], [acts])) for a in agents)
        noise.append(first - second)
    assert not noise[1].any()
    assert np.abs(noise[0] - noise[2]).max() > 0.01


def test_a_slot_counts_policy_frames_from_the_first_hand_over_and_begins_again_with_the_next_episode():
    slots, yes, no = Histories(1), np.ones(1, bool), np.zeros(1, bool)
    state = np.zeros(1, EPISODE)
    state["status"], state["scenario"] = RUNNING, 1
    seen = []
    for frame, episode, acts in ((0, 1, no), (2, 1, yes), (4, 1, no), (6, 1, yes), (0, 2, no), (2, 2, yes)):
        state["frame"], state["episode"], state["vehicle_speed"] = frame, episode, 3.0 + frame
        begins, steps = slots.take(state, yes, acts)
        seen.append((bool(begins[0]), bool(steps[0]), int(slots.step[0]) if steps[0] else None, bool(slots.driven[0])))
    assert seen == [
        (False, False, None, False),
        (True, True, 0, False),
        (False, True, 1, False),
        (False, True, 2, True),
        (False, False, None, False),
        (True, True, 0, False),
    ]
    assert slots.done[0, 0].tolist() == pytest.approx([20.0, 0.0])  # 2 m/s in 0.1 s
    assert motion_of(state)[0, 1] == 5.0
