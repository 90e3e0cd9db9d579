import numpy as np
import pytest
import torch

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.actor import previous
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.streaming import StreamingActor

SMALL = NetworkConfig(hidden=16, heads=2)

STEPS, CAME = 200, [1.5, -0.5]  # [m/s2] the acceleration before the first step


def episode(batch: int, steps: int, seed: int = 0):
    rng = np.random.default_rng(seed)
    curvttc = rng.uniform(0.0, 8.0, (batch, steps))
    curvttc[0] = np.inf
    return rng.normal(0.0, 3.0, (batch, steps, 6)).astype(np.float32), curvttc


def streamed(weights, observation, curvttc):
    batch, steps, _ = observation.shape
    actor = StreamingActor(weights, batch)
    every = np.ones(batch, bool)
    actor.executed(np.tile(np.float32(CAME), (batch, 1)), every)
    out = [actor.step(observation[:, t], curvttc[:, t], np.full(batch, t == 0), every) for t in range(steps)]
    return np.stack(out, axis=1)


@pytest.mark.parametrize("config", [SMALL, NetworkConfig(hidden=256, layers=2)], ids=["small", "table_8"])
def test_streaming_equals_the_whole_history_over_200_steps(networks, config):
    made = networks(config)
    observation, curvttc = episode(3, STEPS)
    actions = streamed(made.weights({}, {}).actor("vehicle"), observation, curvttc)
    with torch.no_grad():
        whole = made.actor["vehicle"](
            torch.from_numpy(observation),
            previous(torch.from_numpy(actions), torch.tensor([CAME]).expand(3, -1)),
            torch.from_numpy(curvttc),
        )
    assert np.abs(actions).mean() > 0.05  # the actors do act
    np.testing.assert_allclose(actions, whole.numpy(), atol=1e-5)


def test_a_row_keeps_its_bits_in_any_batch_at_any_place(networks):
    weights = networks().weights({}, {}).actor("vehicle")
    observation, curvttc = episode(150, 12)
    together = streamed(weights, observation, curvttc)
    shuffle = np.random.default_rng(1).permutation(150)
    assert np.array_equal(streamed(weights, observation[shuffle], curvttc[shuffle]), together[shuffle])
    for size in (1, 2, 3, 5, 64):
        assert np.array_equal(streamed(weights, observation[:size], curvttc[:size]), together[:size])


def test_rows_that_are_not_active_keep_their_history_and_return_zero(networks):
    weights = networks().weights({}, {}).actor("vehicle")
    observation, curvttc = episode(1, 6)
    alone = streamed(weights, observation, curvttc)
    actor = StreamingActor(weights, 2)
    actor.executed(np.tile(np.float32(CAME), (2, 1)), np.ones(2, bool))
    for t in range(6):
        for active in ([False, True], [True, False]):
            seen = np.where(np.array(active)[:, None], observation[0, t], np.nan).astype(np.float32)
            action = actor.step(seen, np.full(2, curvttc[0, t]), np.full(2, t == 0), np.array(active))
            assert np.array_equal(action[int(active[1])], alone[0, t])
            assert not action[int(active[0])].any()


def test_an_observation_that_is_not_a_number_is_refused_by_row(networks):
    actor = StreamingActor(networks().weights({}, {}).actor("vehicle"), 3)
    observation = np.zeros((3, 6), np.float32)
    observation[2, 1] = np.nan
    every = np.ones(3, bool)
    with pytest.raises(InvalidInput, match="row 2"):
        actor.step(observation, np.zeros(3), every, every)
    with pytest.raises(InvalidInput, match=r"observation: expected shape \(3, 6\), got \(2, 6\)"):
        actor.step(observation[:2], np.zeros(3), every, every)
