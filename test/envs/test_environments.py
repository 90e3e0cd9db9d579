"""The doors: the ecosystem's own contract tests, the same bits batched and alone, and a driving system that learns."""

import pickle

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="the extra rl is not installed")
pytest.importorskip("pettingzoo", reason="the extra rl is not installed")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from pettingzoo.test import parallel_api_test  # noqa: E402
from synthetic import random_weights  # noqa: E402

from vpsci_ros.envs import ENV_ID, task  # noqa: E402
from vpsci_ros.envs.parallel import COLLISION_REWARD, GOAL_REWARD, parallel_env  # noqa: E402
from vpsci_ros.envs.right_turn import RightTurnEnv  # noqa: E402
from vpsci_ros.envs.vector import RightTurnVectorEnv  # noqa: E402
from vpsci_ros.errors import InvalidInput  # noqa: E402
from vpsci_ros.policy.policy_config import NetworkConfig  # noqa: E402
from vpsci_ros.policy.weights import Weights  # noqa: E402
from vpsci_ros.world import WorldConfig, load_scenarios  # noqa: E402
from vpsci_ros.world.state import EPISODE  # noqa: E402
from vpsci_ros.world.tables import tables_from  # noqa: E402

WALKER = {"pedestrian": "social_force"}


def small_weights() -> Weights:
    return random_weights(NetworkConfig(hidden=8, layers=1, heads=2))


def drive(observation: np.ndarray) -> np.ndarray:
    """Follow the lane by pure pursuit at 3 m/s and stop for a pedestrian ahead; action float32[..., 2]."""
    forward, left = observation[..., 8], observation[..., 9]
    steer = np.arctan(2.875 * 2 * left / (forward**2 + left**2)) / 0.52
    pedal = 0.3 * (3.0 - observation[..., 0])
    ahead = (observation[..., 16] > 0) & (observation[..., 16] < 8) & (np.abs(observation[..., 17]) < 2)
    return np.stack([steer, np.where(ahead, -1.0, pedal)], axis=-1).clip(-1, 1).astype(np.float32)


def test_gymnasiums_checker_finds_nothing():
    check_env(gymnasium.make(ENV_ID, render_mode="rgb_array", **WALKER).unwrapped)


def test_pettingzoos_parallel_api_test_passes():
    parallel_api_test(parallel_env(), num_cycles=300)


def test_the_learned_pedestrian_answers():
    env = RightTurnEnv(scenarios=[1], weights=small_weights())
    walker = RightTurnEnv(scenarios=[1], pedestrian="autopilot")
    controlled = differs = False
    for episode in range(6):
        options = {"scenario": 1, "episode": episode}
        observation, _ = env.reset(seed=3, options=options)
        walker.reset(seed=3, options=options)
        over = False
        while not over:
            action = drive(observation)
            observation, _, terminated, truncated, info = env.step(action)
            ignorant, _, ended, cut, _ = walker.step(action)
            controlled |= info["pedestrian_controlled"]
            differs |= not np.array_equal(observation[16:20], ignorant[16:20])
            over = terminated or truncated or ended or cut
    assert controlled
    assert differs


def test_an_environment_of_a_batch_is_to_the_bit_the_one_alone():
    kind = {"weights": small_weights()}
    batch = RightTurnVectorEnv(3, **kind)
    single = [RightTurnEnv(**kind) for _ in range(3)]
    observations, infos = batch.reset(seed=10)
    for i, env in enumerate(single):
        alone, _ = env.reset(seed=10 + i)
        assert alone.tobytes() == observations[i].tobytes()
    finished = 0
    for _ in range(250):
        actions = drive(observations)
        observations, rewards, terminated, truncated, infos = batch.step(actions)
        for i, env in enumerate(single):
            alone, reward, ended, cut, info = env.step(actions[i])
            assert (reward, ended, cut) == (rewards[i], terminated[i], truncated[i])
            assert info["curvttc"] == infos["curvttc"][i]
            if ended or cut:
                finished += 1
                assert alone.tobytes() == infos["final_obs"][i].tobytes()
                alone, _ = env.reset()
            assert alone.tobytes() == observations[i].tobytes()
    assert finished >= 3


def test_environments_without_a_seed_start_different_episodes_and_each_goes_on_in_its_own():
    batch = RightTurnVectorEnv(4, **WALKER)
    first, infos = batch.reset()
    assert len({row.tobytes() for row in first}) > 1
    assert infos["scenario"].tolist() == [1, 1, 1, 1]
    assert batch.reset()[1]["scenario"].tolist() == [2, 2, 2, 2]
    mixed = RightTurnVectorEnv(2, **WALKER)
    (seeded, _), _ = mixed.reset(seed=[7, None])
    single = RightTurnEnv(**WALKER)
    assert single.reset(seed=7)[0].tobytes() == seeded.tobytes()
    assert mixed.reset(seed=[7, None])[1]["scenario"].tolist() == [1, 2]

    new, pair = RightTurnEnv(**WALKER), parallel_env(scenarios=[1])
    assert len({pickle.loads(pickle.dumps(new)).reset()[0].tobytes() for _ in range(4)}) > 1
    assert len({pickle.loads(pickle.dumps(pair)).reset()[0]["vehicle"].tobytes() for _ in range(4)}) > 1


def test_a_copy_in_mid_episode_goes_on_to_the_bit():
    env = RightTurnEnv(weights=small_weights(), render_mode="rgb_array")
    observation, _ = env.reset(seed=2)
    for _ in range(30):
        observation, *_ = env.step(drive(observation))
    env.render()
    copied = pickle.loads(pickle.dumps(env))
    for _ in range(250):  # into the next episode
        (one, *rest), (other, *same) = env.step(drive(observation)), copied.step(drive(observation))
        assert (one.tobytes(), rest) == (other.tobytes(), same)
        observation = env.reset()[0] if rest[1] or rest[2] else one
        if rest[1] or rest[2]:
            assert copied.reset()[0].tobytes() == observation.tobytes()


def episode_of(env, options, act):
    observation, _ = env.reset(seed=1, options=options)
    total, rows = 0.0, [observation]
    while True:
        observation, reward, terminated, truncated, info = env.step(act(observation))
        total, rows = total + reward, [*rows, observation]
        if terminated or truncated:
            return total, np.array(rows), terminated, info


def test_leaving_the_lane_ends_the_episode_at_a_cost():
    env = RightTurnEnv(scenarios=[1], **WALKER)
    total, rows, terminated, info = episode_of(env, None, lambda o: np.float32([1.0, 0.3]))
    assert terminated
    assert info["outcome"] == "none"
    assert abs(rows[-1, 3]) > task.OFF_LANE
    assert total < 0.5 * task.AT_FAILURE


def test_the_lane_is_left_at_the_same_cost_on_both_sides():
    state, observation = np.zeros(2, EPISODE), np.zeros((2, task.SIZE), np.float32)
    observation[:, 3] = 5.0, -5.0
    reward, terminated, _ = task.outcome(state, state, observation)
    assert terminated.all()
    assert reward.tolist() == [task.AT_FAILURE - task.LATERAL * task.OFF_LANE**2] * 2


def test_who_is_beyond_sight_is_observed_at_its_edge_in_the_same_direction():
    """(300, -400) m is 500 m away, so that it is seen at a tenth of it; (30, 40) m is at the edge, and stays."""
    tables = tables_from(load_scenarios([1]))
    state = np.zeros(2, EPISODE)
    state["vehicle_x"], state["vehicle_y"] = 10.0, 20.0
    state["pedestrian_x"], state["pedestrian_y"] = [310.0, 40.0], [-380.0, 60.0]
    seen = task.observe(state, np.full(2, np.inf), tables)[:, 16:18]
    assert np.allclose(seen, [[30.0, -40.0], [30.0, 40.0]], atol=1e-5)
    assert task.SIGHT == 50.0


def test_the_picture_shows_lane_vehicle_and_pedestrian():
    env = RightTurnEnv(scenarios=[1], render_mode="rgb_array", **WALKER)
    env.reset(seed=1)
    image = env.render()
    assert image.shape == (480, 480, 3)
    assert image.dtype == np.uint8
    for colour in ((8, 81, 156), (165, 15, 21), (185, 185, 181), (247, 247, 244)):
        assert (image == colour).all(axis=-1).sum() > 20
    for _ in range(20):
        env.step(np.float32([0, 0.3]))
    assert (env.render() != image).any()


def braking(observation):
    return {"vehicle": np.float32([-5, 0]), "pedestrian": np.float32([0, 0])}


def chasing(observation):
    return {"vehicle": np.float32([0, 0]), "pedestrian": -observation["pedestrian"][2:4]}


@pytest.mark.parametrize(("act", "expected"), [(braking, "timeout"), (chasing, "collision")])
def test_both_agents_are_paid_by_equations_25_and_26(act, expected):
    env = parallel_env(scenarios=[1, 3, 4])
    outcomes = set()
    for number in range(12):
        observation, _ = env.reset(seed=number)
        rewards = dict.fromkeys(env.possible_agents, 0.0)
        while env.agents:
            observation, reward, _, _, infos = env.step(act(observation))
            rewards = {agent: rewards[agent] + reward[agent] for agent in rewards}
        outcomes.add(infos["vehicle"]["outcome"])
        collided = COLLISION_REWARD if infos["vehicle"]["outcome"] == "collision" else 0.0
        for reward in rewards.values():
            assert reward in (collided, collided + GOAL_REWARD)
    assert expected in outcomes


@pytest.mark.parametrize(("given", "gain"), [({}, 1.0), ({"pedestrian_gain": 0.5}, 0.5)])
def test_the_gain_is_the_share_of_the_pedestrians_acceleration_that_becomes_motion(given, gain):
    env = parallel_env(scenarios=[1], **given)
    still, pushed = np.float32([0.0, 0.0]), np.float32([0.4, -0.3])  # 0.5 m/s2: within the jerk of the first tick
    changes = []
    for action in (still, pushed):
        before, _ = env.reset(seed=4)
        after, *_ = env.step({"vehicle": still, "pedestrian": action})
        changes.append(after["pedestrian"][0:2] - before["pedestrian"][0:2])
    assert changes[1] - changes[0] == pytest.approx(gain * pushed * 0.1, abs=2e-3)
    assert WorldConfig().pedestrian_gain == 1.0, "the shipped policies' gain is the environment's"


def test_an_action_of_another_size_is_refused_in_words():
    env = RightTurnEnv(**WALKER)
    env.reset(seed=1)
    with pytest.raises(
        InvalidInput, match=r"an action is \(steer, pedal\), two numbers of -1 to 1; got \[0.0, 1.0, 0.0\]"
    ):
        env.step(np.array([0.0, 1.0, 0.0], np.float32))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RightTurnEnv(pedestrian="dancer"), "pedestrian = 'dancer'"),
        (lambda: RightTurnEnv(render_mode="human", **WALKER), "expected 'rgb_array' or None"),
        (lambda: RightTurnEnv(**WALKER).reset(options={"scenario": 1}), "expected scenario and episode"),
        (lambda: RightTurnVectorEnv(2, **WALKER).reset(seed=[1]), "one number or 2 of them"),
        (lambda: RightTurnEnv(**WALKER).reset(seed=2**64), r"seed = \d+: expected a whole number from 0 to 2\^63 - 1"),
    ],
)
def test_bad_arguments_are_refused(make, message):
    with pytest.raises(InvalidInput, match=message):
        make()
