"""What a stochastic policy draws is a function of the episode, to the bit in any batch; temperature 0 is the middle."""

import dataclasses

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.config import NetworkConfig, PolicyConfig
from vpsci_ros.policy.draws import draw_innovation, draw_latent, keys
from vpsci_ros.policy.streaming import Draws, StreamingActor
from vpsci_ros.policy.weights import Weights, weights_from_bytes, weights_to_bytes
from vpsci_ros.world import RUNNING, World, WorldConfig, load_scenarios
from vpsci_ros.world.counter_rng import STREAM_INNOVATION, normals
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.observation import AGENTS

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, latent=5, actor_hidden=[8, 8], critic_hidden=[8, 8])
EPISODES = [(scenario, number) for number in range(4) for scenario in range(1, 9)]


def stochastic(config: NetworkConfig = SMALL) -> Networks:
    """Networks whose every weight matters."""
    torch.manual_seed(3)
    networks = Networks(config)
    with torch.no_grad():
        for agent in AGENTS:
            networks.actor[agent].head[-1].weight.normal_(0.0, 0.3)
    return networks


@pytest.fixture(scope="module")
def weights() -> Weights:
    return stochastic().weights({}, {})


def trajectories(
    weights: Weights, episodes: list[tuple[int, int]], batch: int, temperature: float = 1.0, seed: int = 7
) -> dict[tuple[int, int], bytes]:
    """Return every episode's states and actions as bytes, by (scenario, number)."""
    world = World(WorldConfig(), load_scenarios(range(1, 9)), episodes, batch, seed)
    out: dict[tuple[int, int], bytes] = {}
    agents = policies(weights, world, dict.fromkeys(AGENTS, PolicyConfig(seed=seed, temperature=temperature)))
    for step in Loop(world, agents=agents):
        for i in np.flatnonzero(step.tick.state["status"] == RUNNING):
            row = step.tick.state[i]
            key = int(row["scenario"]), int(row["episode"])
            seen = b"".join(
                row[name].tobytes() for name in ("frame", "vehicle_x", "vehicle_y", "pedestrian_x", "pedestrian_y")
            )
            done = b"".join(a[i].tobytes() for a in map(step.actions.of, AGENTS) if a is not None)
            out[key] = out.get(key, b"") + seen + done
    return out


def innovations(scenario: int, episodes: NDArray[np.int64], frame: int, agent: int) -> NDArray[np.float32]:
    key = keys(len(episodes), 1, scenario, episodes, frame=frame)
    return draw_innovation(key, agent, np.ones(len(episodes), bool))


def test_innovations_are_the_normals_of_their_stream_and_0_where_nobody_acts() -> None:
    episodes = np.arange(50)
    stream = STREAM_INNOVATION[1] + (7 << 8)
    assert np.array_equal(innovations(3, episodes, 7, 1), normals(1, 3, episodes, stream, 2).astype(np.float32))
    assert not draw_innovation(keys(2, 1, 1, 1, 1, 1), 0, np.zeros(2, bool)).any()


def test_numbers_are_standard_normal_and_of_each_agent_and_frame_their_own() -> None:
    episodes = np.arange(20000)
    drawn = [draw_latent(1, 3, episodes, agent, 6) for agent in (0, 1)]
    drawn += [innovations(3, episodes, frame, agent) for agent in (0, 1) for frame in (0, 2)]
    together = np.concatenate(drawn, axis=1)
    assert np.abs(together.mean(axis=0)).max() < 0.03
    assert np.abs(np.cov(together.T) - np.eye(together.shape[1])).max() < 0.05


def test_an_episode_is_a_function_of_its_seed_whatever_the_batch_and_the_order(weights: Weights) -> None:
    together = trajectories(weights, EPISODES, 32)
    backwards = trajectories(weights, EPISODES[::-1], 5)
    alone = trajectories(weights, EPISODES[9:10], 1)
    assert together == backwards
    assert alone[EPISODES[9]] == together[EPISODES[9]]
    assert together != trajectories(weights, EPISODES, 32, seed=8)


def test_temperature_0_is_the_deterministic_middle_and_1_is_not(weights: Weights) -> None:
    """The middle's weights: the same tensors without what the latent numbers and the noise need."""
    config = dataclasses.replace(SMALL, latent=0)
    tensors = {
        name: value for name, value in weights.tensors.items() if not name.endswith(("persistence_logit", "stillness"))
    }
    for agent in AGENTS:
        head = f"{agent}_actor.head"
        tensors[f"{head}.0.weight"] = tensors[f"{head}.0.weight"][:, : SMALL.hidden].copy()
        tensors |= {f"{head}.4.{part}": tensors[f"{head}.4.{part}"][:2].copy() for part in ("weight", "bias")}
    middle = trajectories(Weights(config, tensors), EPISODES, 8)
    assert trajectories(weights, EPISODES, 8, temperature=0.0) == middle
    assert trajectories(weights, EPISODES, 8, temperature=1.0) != middle


def test_the_streamed_action_is_the_distribution_that_was_learned(weights: Weights) -> None:
    networks, batch = stochastic(), 4000
    observation = np.tile(np.array([3.0, 0.0, -5.0, 2.0, 3.0, -1.0], np.float32), (batch, 1))
    every, ttc = np.ones(batch, bool), np.full(batch, 2.0)
    who = np.tile(draw_latent(1, 1, [1], 0, SMALL.latent), (batch, 1))
    actor = StreamingActor(weights.actor("vehicle"), batch)
    noise, streamed = np.zeros((2, batch, 2), np.float32), []
    for frame in range(2):
        noise[frame] = innovations(1, np.arange(batch), frame, 0)
        streamed.append(
            actor.step(observation, ttc, ~every if frame else every, every, Draws(who, noise[frame], np.float32(1.0)))
        )
    taught = networks.actor["vehicle"]
    with torch.no_grad():
        state = taught.empty_history()
        seen, before, eps = torch.from_numpy(observation), torch.zeros(batch, 2), torch.from_numpy(noise[0])
        for frame in range(2):
            mean, scale = taught.distribution(seen, before, torch.full((batch,), 2.0), state, torch.from_numpy(who))
            eps = taught.next_noise(eps, torch.from_numpy(noise[1])) if frame else eps
            before = (mean + scale * taught.burst(eps)).clamp(-5.0, 5.0)
            np.testing.assert_allclose(streamed[frame], before.numpy(), atol=1e-4)


def test_stochastic_weights_survive_a_file(weights: Weights) -> None:
    again = weights_from_bytes(weights_to_bytes(weights))
    assert again.network.latent == SMALL.latent
    assert again.digest() == weights.digest()
