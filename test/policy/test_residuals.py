"""Residuals of recorded people: both agents borrow one sequence of one of the most similar onsets, in any batch."""

from dataclasses import replace

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.config import NetworkConfig, PolicyConfig
from vpsci_ros.policy.draws import keys, keys_of
from vpsci_ros.policy.residuals import (
    FEATURES,
    FURTHEST,
    NEAREST,
    SECOND,
    SECONDS,
    Borrower,
    Residuals,
    describe,
    moments_in,
    moments_of,
    slopes,
)
from vpsci_ros.policy.weights import Weights, load_weights, save_weights, weights_from_bytes, weights_to_bytes
from vpsci_ros.world import EPISODE, RUNNING
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import Tick

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, actor_hidden=[8, 8], critic_hidden=[8, 8], residuals=True)
LENGTH = 3
MOMENT = np.array([[2.0, -0.5, 0.1, 6.0, 2.0, 0.1, -1.2]])  # the pedestrian comes from the left


def bank(count: int = 40, sources: int = 1) -> Residuals:
    """Sequence k begins k units away from `MOMENT` and is k everywhere, but for its steering: k / 100."""
    features = np.zeros((count, FEATURES), np.float32)
    features[:] = describe(MOMENT)[0]
    features[:, 0] += np.arange(count)
    steps = np.repeat(np.arange(count, dtype=np.float32), LENGTH)[:, None] * np.array([1, 0.01, 1, 1], np.float32)
    return Residuals(
        features=features,
        scale=np.ones((sources, FEATURES), np.float32),
        side=np.ones(count, np.float32),
        source=(np.arange(count) % sources).astype(np.float32),
        length=np.full(count, LENGTH, np.float32),
        steps=steps,
        slope=np.zeros(slopes(sources), np.float32),
    )


def borrowed(count: int, agent: int = 0, steps: int = 1, moment: np.ndarray = MOMENT, people: int = 0) -> np.ndarray:
    """What `count` slots borrow at the same moment, float32[steps, count, 2]."""
    borrower = Borrower(bank(sources=people + 1), agent, count, people)
    every, moments = np.ones(count, bool), np.repeat(moment, count, axis=0)
    return np.stack(
        [borrower.step(moments, keys(count, 7, 0, np.arange(count)), every & (k == 0), every) for k in range(steps)]
    )


@pytest.fixture(scope="module")
def weights() -> Weights:
    networks = Networks(SMALL)
    networks.residuals = lambda actors: bank().tensors()
    return networks.weights({}, {"data": {"people": ["here"]}})


def test_a_moment_and_its_mirror_image_are_similar_and_know_their_sides() -> None:
    mirrored = MOMENT * np.array([1, 1, -1, 1, -1, 1, -1])
    features, side = describe(np.concatenate([MOMENT, mirrored]))
    assert features[0].tobytes() == features[1].tobytes()
    assert side.tolist() == [1.0, -1.0]
    np.testing.assert_allclose(features[0], [2.0, np.hypot(0.1, 1.2), 6.0, 2.0, 0.1, -1.2, -0.5, 0.1])


def test_each_of_the_nearest_onsets_is_borrowed_as_often_and_no_other() -> None:
    along = borrowed(4000)[0, :, 0]
    counts = np.bincount(along.astype(int), minlength=40)
    assert (counts[NEAREST:] == 0).all()
    assert counts[:NEAREST].min() > 4000 / NEAREST - 5 * np.sqrt(4000 / NEAREST)


def test_both_agents_borrow_of_the_same_person() -> None:
    vehicle, pedestrian = borrowed(100, agent=0)[0], borrowed(100, agent=1)[0]
    assert (vehicle[:, 0] == pedestrian[:, 0]).all()
    assert len(set(vehicle[:, 0])) > 8


def test_people_of_other_recordings_lend_nothing() -> None:
    assert set(borrowed(400, people=1)[0, :, 0] % 2) == {1.0}


def test_a_steering_residual_is_a_curvature() -> None:
    twice = MOMENT * np.array([2, 1, 1, 1, 1, 1, 1])
    slow, fast = borrowed(50)[0], borrowed(50, moment=twice)[0]
    np.testing.assert_allclose(slow[:, 1], slow[:, 0] * 0.01 * 2.0**2, rtol=1e-6)  # [1/m] times speed squared
    np.testing.assert_allclose(fast[:, 1], fast[:, 0] * 0.01 * 4.0**2, rtol=1e-6)


def test_what_points_left_is_mirrored_where_the_pedestrian_comes_from_the_other_side() -> None:
    mirrored = MOMENT * np.array([1, 1, -1, 1, -1, 1, -1])
    left, right = borrowed(50, agent=1)[0], borrowed(50, agent=1, moment=mirrored)[0]
    np.testing.assert_array_equal(left * [1, -1], right)


def test_a_sequence_is_undivided_and_another_one_follows_it() -> None:
    borrower, every = Borrower(bank(), 0, 200), np.ones(200, bool)
    moments, along = np.repeat(MOMENT, 200, axis=0), []
    for frame in range(2 * LENGTH):
        key = keys(200, 7, 0, np.arange(200), frame=frame)
        along.append(borrower.step(moments, key, every & (frame == 0), every)[:, 0])
    first, second = np.array(along[:LENGTH]), np.array(along[LENGTH:])
    assert (first == first[0]).all()
    assert (second == second[0]).all()
    assert (first[0] != second[0]).mean() > 0.8


def long_bank(length: int) -> Residuals:
    """One sequence of zeros that begins 0.5 m/s slower and 1 m less aside than `MOMENT`, where people act otherwise."""
    own = bank(1)
    features, slope = own.features.copy(), np.zeros(slopes(1), np.float32)
    features[0, [0, 3]] -= 0.5, 1.0  # speed and place aside
    slope[0, 0] = np.arange(SECONDS)[:, None] + np.array([1, 0.01, 3, 4])
    slope[0, 3] = np.array([0, 0.01, 0, 1])
    length = np.full(1, length, np.float32)
    return own._replace(features=features, length=length, slope=slope, steps=np.zeros((int(length[0]), 4), np.float32))


@pytest.mark.parametrize("side", [1, -1])
def test_what_is_borrowed_is_adjusted_for_how_the_onsets_differ_in_each_of_three_seconds(side: int) -> None:
    moment = MOMENT * np.array([1, 1, side, 1, side, 1, side])
    length, one = (SECONDS + 1) * SECOND, np.ones(1, bool)
    for agent in (0, 1):
        borrower = Borrower(long_bank(length), agent, 1)
        done = np.array(
            [borrower.step(moment, keys(1, 7, 0, np.zeros(1, np.int64)), one & (k == 0), one)[0] for k in range(length)]
        )
        second = np.arange(SECONDS)
        # 0.5 m/s times a slope and 1 m times another; the vehicle steers by a curvature, at 2 m/s
        along = 0.5 * (second + (1, 3)[agent])
        left = (0.5 * (second + 0.01) + 0.01) * 2.0**2 if agent == 0 else 0.5 * (second + 4) + 1.0
        for column, value in enumerate((along, left * side)):
            np.testing.assert_allclose(done[:, column], np.append(value, 0.0).repeat(SECOND), rtol=1e-6)


def test_a_difference_beyond_what_was_seen_is_adjusted_for_as_the_largest() -> None:
    fast = MOMENT + np.array([[5.0, 0, 0, 0, 0, 0, 0]])
    step = Borrower(long_bank(SECOND), 1, 1).step(
        fast, keys(1, 7, 0, np.zeros(1, np.int64)), np.ones(1, bool), np.ones(1, bool)
    )[0]
    np.testing.assert_allclose(step[0], FURTHEST * 3)


def state_of(episodes: np.ndarray) -> np.ndarray:
    state = np.zeros(len(episodes), EPISODE)
    state["status"], state["scenario"], state["episode"] = RUNNING, 1, episodes
    state["vehicle_speed"], state["pedestrian_x"], state["pedestrian_y"] = 2.0 + 0.1 * episodes, 6.0, 2.0
    state["pedestrian_vy"] = -1.2
    return state


def acted(weights: Weights, agent: str, episodes: np.ndarray, temperature: float = 1.0) -> np.ndarray:
    """Actions of five steps in these episodes, float32[5, B, 2]."""
    own = PolicyAgent(agent, 3, False, temperature=temperature)
    own.load(weights, version=1)
    state, near, every = state_of(episodes), np.full(len(episodes), 2.0), np.ones(len(episodes), bool)
    out = []
    for number in range(5):
        tick = Tick(2 * number, state, every)
        out.append(own.act(tick, tick.assessed(near, near, every)).copy())
        state["controlled"], state["frame"] = 1, 2 * number + 2
    return np.stack(out)


def test_a_vehicle_that_leaves_steering_to_the_lane_remembers_that_it_did(weights: Weights) -> None:
    own = PolicyAgent("vehicle", 3, False)
    own.load(weights, version=1)
    state, every = state_of(np.arange(8)), np.ones(8, bool)
    tick = Tick(0, state, every)
    action = own.act(tick, tick.assessed(np.full(8, 2.0), np.full(8, 2.0), every))
    assert (action[:, 0] != 0.0).all()
    assert (action[:, 1] == 0.0).all()
    assert own._actor._action.tobytes() == action.tobytes()


def test_a_policy_at_work_takes_up_the_residuals_of_other_weights(weights: Weights) -> None:
    own = PolicyAgent("pedestrian", 3, False)
    state, every = state_of(np.arange(8)), np.ones(8, bool)
    tick, actions = Tick(0, state, every), []
    others = {f"residuals.{name}": value for name, value in bank()._replace(steps=-bank().steps)._asdict().items()}
    for version, loaded in enumerate((weights, weights, replace(weights, tensors=weights.tensors | others)), start=1):
        own.load(loaded, version)
        actions.append(own.act(tick, tick.assessed(np.full(8, 2.0), np.full(8, 2.0), every)))
    first, again, opposite = (np.sign(np.round(action[:, 0])) for action in actions)
    assert (first == again).all()
    assert (first == -opposite).all()
    assert np.abs(first).sum() > 4


@pytest.mark.parametrize("agent", AGENTS)
def test_an_episode_borrows_the_same_alone_and_among_others(weights: Weights, agent: str) -> None:
    together = acted(weights, agent, np.arange(70))
    for episode in (0, 1, 42, 69):
        assert acted(weights, agent, np.array([episode]))[:, 0].tobytes() == together[:, episode].tobytes()


def test_without_temperature_a_policy_does_what_its_networks_say(weights: Weights) -> None:
    mean, plain = (
        acted(weights, "pedestrian", np.arange(8), temperature=0.0),
        NetworkConfig(**vars(SMALL) | {"residuals": False}),
    )
    tensors = {name: value for name, value in weights.tensors.items() if not name.startswith("residuals.")}
    np.testing.assert_array_equal(mean, acted(Weights(plain, tensors), "pedestrian", np.arange(8)))
    assert np.abs(acted(weights, "pedestrian", np.arange(8)) - mean).max() > 0.5


def test_the_vehicle_leaves_steering_to_the_lane(weights: Weights) -> None:
    actions = acted(weights, "vehicle", np.arange(8))
    assert (actions[..., 1] == 0.0).all()
    assert np.abs(actions[..., 0]).max() > 0.5


def test_a_file_keeps_what_people_did(weights: Weights, tmp_path) -> None:
    save_weights(tmp_path / "w.safetensors", weights)
    loaded = load_weights(tmp_path / "w.safetensors")
    for own, kept in zip(weights.residuals(), loaded.residuals(), strict=True):
        assert own.tobytes() == kept.tobytes()
    again = Networks.from_weights(loaded).weights({}, weights.facts)
    assert weights_to_bytes(again) == weights_to_bytes(weights)


@pytest.mark.parametrize(
    ("tensor", "value", "message"),
    [
        ("steps", None, "residuals.steps is missing"),
        ("length", np.full(40, 4, np.float32), r"residuals.steps: expected float32\[160, 4\], got float32\[120, 4\]"),
        ("scale", np.zeros((1, FEATURES), np.float32), "scales above 0"),
        ("side", np.full(40, np.nan, np.float32), "residuals.side holds values that are not finite"),
    ],
)
def test_damaged_residuals_are_refused(weights: Weights, tensor: str, value: np.ndarray | None, message: str) -> None:
    tensors = weights.tensors | {f"residuals.{tensor}": value}
    with pytest.raises(InvalidInput, match=message):
        weights_to_bytes(Weights(weights.network, {k: v for k, v in tensors.items() if v is not None}))


def test_residuals_of_unknown_people_are_refused(weights: Weights) -> None:
    loaded = weights_from_bytes(weights_to_bytes(weights))
    assert loaded.people("") == loaded.people("here") == 0
    agent = PolicyAgent("vehicle", 1, False, people=PolicyConfig(people="there").people)
    with pytest.raises(InvalidInput, match="people: expected one of here, got 'there'"):
        agent.load(loaded, version=1)


def test_residuals_and_latent_numbers_exclude_each_other() -> None:
    with pytest.raises(InvalidInput, match="latent = 8"):
        NetworkConfig(latent=8, residuals=True)


def test_keys_and_moments_of_records_are_those_of_their_columns():
    rng, state = np.random.default_rng(5), np.zeros(9, EPISODE)
    for name in ("scenario", "episode", "pedestrian", "frame"):
        state[name] = rng.integers(1, 100, 9)
    for name in ("vehicle_acceleration", "vehicle_curvature", "vehicle_speed"):
        state[name] = rng.normal(size=9)
    seen = rng.normal(size=(9, 6)).astype(np.float32)
    columns = (state[name] for name in ("scenario", "episode", "pedestrian", "frame"))
    assert np.array_equal(keys_of(state, 11), keys(9, 11, *columns))
    expected = moments_of(seen, state["vehicle_acceleration"], state["vehicle_curvature"] * state["vehicle_speed"])
    assert np.array_equal(moments_in(state, seen), expected)
