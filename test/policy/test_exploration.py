import numpy as np

from vpsci_ros.policy.exploration import amplitude, exploration_noise
from vpsci_ros.policy.policy_config import NoiseConfig


def test_amplitude_is_that_of_equation_16():
    np.testing.assert_allclose(amplitude([0, 125, 10**6]), [0.21, 0.2 * np.exp(-1.0) + 0.01, 0.01])


def test_noise_is_a_function_of_seed_scenario_episode_step_and_agent():
    scenario, episode, step = np.array([1, 2, 3, 3]), np.array([5, 5, 6, 7]), np.array([0, 1, 2, 3])
    together = exploration_noise(9, scenario, episode, step, 0)
    for i in range(4):
        alone = exploration_noise(9, scenario[i : i + 1], episode[i : i + 1], step[i : i + 1], 0)
        assert np.array_equal(alone[0], together[i])
    others = [
        exploration_noise(8, scenario, episode, step, 0),
        exploration_noise(9, scenario, episode, step, 1),
        exploration_noise(9, scenario, episode, step + 1, 0),
        exploration_noise(9, scenario, episode + 1, step, 0),
    ]
    for other in others:
        assert (other != together).all()


def test_noise_has_the_deviation_that_is_set_and_no_bias():
    config = NoiseConfig(start=0.0, floor=0.5)
    for step in (0, 3, 40):
        draws = exploration_noise(1, np.ones(20000, int), np.arange(20000), np.full(20000, step), 1, config, limit=2.0)
        assert np.abs(draws.mean(axis=0)).max() < 0.03
        np.testing.assert_allclose(draws.std(axis=0), 1.0, atol=0.02)


def test_noise_leans_one_way_for_a_second():
    """The sums of steps t and t + k share 10 - k of their 10 draws."""
    episodes, even = np.arange(20000), NoiseConfig(start=0.0)  # as large in each
    at = [exploration_noise(1, np.ones(20000, int), episodes, np.full(20000, t), 0, even)[:, 0] for t in (20, 25, 30)]
    assert abs(np.corrcoef(at[0], at[1])[0, 1] - 0.5) < 0.03
    assert abs(np.corrcoef(at[0], at[2])[0, 1]) < 0.03
