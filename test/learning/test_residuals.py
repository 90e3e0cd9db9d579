"""What people did beside the actors' mean: with that mean it is what they did, and nobody borrows it from himself."""

import numpy as np
import pytest
import torch
from synthetic import synthetic_near_misses
from threadpoolctl import threadpool_limits

from vpsci_ros.data.interactions import from_table
from vpsci_ros.errors import InvalidInput
from vpsci_ros.kinematics.scene import Scene, advance
from vpsci_ros.learning.config import EnergyScoreConfig, ImitationConfig, PretrainConfig
from vpsci_ros.learning.energy_score import draw_moments
from vpsci_ros.learning.imitation import Start
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.learning.residuals import RIDGE, Donors, _fit, fitted
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.residuals import FURTHEST, SECOND, SLOWEST, residuals_of, slopes
from vpsci_ros.world.observation import AGENTS

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, layers=1, actor_hidden=[8, 8], residuals=True)
STEPS = 12
CONFIG = PretrainConfig(
    objective="energy_score",
    episodes=3,
    imitation=ImitationConfig(rollouts=8, rollout_steps=STEPS, learning_rate=3e-3, dropout=0.0),
    energy_score=EnergyScoreConfig(samples=4),
)


@pytest.fixture(scope="module")
def interactions():
    return from_table(synthetic_near_misses(40, 1).table, whole_tracks=True)


@pytest.fixture(scope="module")
def networks(interactions) -> Networks:
    torch.manual_seed(0)
    own = Networks(SMALL)
    own.set_statistics(*interactions.samples(), 0.3)
    return own


def test_fitted_accelerations_lead_along_the_recorded_positions(interactions) -> None:
    own, rows = fitted(interactions), np.arange(len(interactions))
    motion = torch.from_numpy(own.motion)
    scene = Scene(motion[:, 0, :2], motion[:, 0, 2], motion[:, 0, 3:5], torch.zeros(len(rows)), *_walker(motion))
    for step in range(10):
        scene = advance(scene, {agent: torch.from_numpy(own.action[agent][:, step].astype(float)) for agent in AGENTS})
    gap = scene.rows().numpy() - interactions.motion[:, 10]
    assert np.median(np.hypot(gap[:, 0], gap[:, 1])) < 0.05
    assert np.median(np.hypot(gap[:, 5], gap[:, 6])) < 0.05


def _walker(motion: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    return motion[:, 0, 5:7], motion[:, 0, 7:9]


def test_the_mean_along_a_track_and_what_was_done_beside_it_are_what_was_done(interactions, networks) -> None:
    donors, own = Donors(interactions, STEPS), fitted(interactions)
    kept = residuals_of(donors.tensors(networks.actor), "here")
    row = int(np.flatnonzero(interactions.first <= interactions.length - 1 - STEPS)[0])
    at, length = interactions.first[row], int(kept.length[0])
    start = Start(*(np.array([value]) for value in (row, max(at - 10, 0), at, False)))
    beside, known = donors._beside(networks.actor, start, length)
    assert known.all()
    assert length == interactions.length[row] - 1 - at
    np.testing.assert_allclose(beside[0].flatten(1).detach().numpy(), kept.steps[:length], atol=1e-6)
    history = torch.from_numpy(own.observation["pedestrian"][row : row + 1, start.begin[0] :])
    done = torch.from_numpy(own.action["pedestrian"][row : row + 1, start.begin[0] :])
    before = torch.cat([torch.zeros(1, 1, 2), done[:, :-1]], dim=1)
    mean = networks.actor["pedestrian"](history, before, torch.from_numpy(own.curvttc[row : row + 1, start.begin[0] :]))
    lead = at - start.begin[0]
    whole = mean[0, lead : lead + length].detach().numpy() + kept.steps[:length, 2:]
    np.testing.assert_allclose(whole, done[0, lead : lead + length], atol=1e-5)


def test_nobody_borrows_from_the_own_clip(interactions) -> None:
    donors = Donors(interactions, STEPS)
    rng = np.random.default_rng(0)
    for row in range(0, len(interactions), 7):
        picked = donors._pick(row, int(interactions.first[row]), 16, rng)
        assert (donors._clip[donors._row[picked]] != donors._clip[row]).all()


def test_slopes_find_by_how_much_people_who_begin_otherwise_act_otherwise(interactions) -> None:
    donors = Donors(interactions, 3 * SECOND)
    rows, first = donors._onsets, donors._fitted.first[donors._onsets]
    features = donors._features[rows, first]
    rng = np.random.default_rng(0)
    effect = np.array([0.5, 0.02, -0.4, 0.3])  # per scaled m/s of the vehicle
    for agent, part in zip(AGENTS, (effect[:2], effect[2:]), strict=True):
        for row, at, own in zip(rows, first, features, strict=True):
            done = part * own[0] * [1.0, donors._side[row, at]] + rng.normal(0.0, 0.01, (3 * SECOND, 2))
            if agent == "vehicle":
                speed = np.hypot(*donors._fitted.motion[row, at : at + 3 * SECOND, 3:5].T)
                done[:, 1] *= np.maximum(speed, SLOWEST) ** 2
            donors._fitted.action[agent][row, at : at + 3 * SECOND] = done
    slope = donors._slopes()
    assert slope.shape == slopes(1)
    drawn_to_zero = 1.0 / (1.0 + RIDGE)  # at most, were the features uncorrelated
    np.testing.assert_allclose(slope[0, 0] / effect, 1.0, atol=1.0 - drawn_to_zero + 0.1)
    assert (np.abs(slope[0, 1:] / effect) < 0.2).all()


def test_a_lender_is_adjusted_in_training_as_at_work(interactions, networks) -> None:
    donors = Donors(interactions, STEPS)
    start = draw_moments(interactions, 6, STEPS, True, np.random.default_rng(0))
    adjusted = donors.borrowed(networks.actor, start, 3, np.random.default_rng(1))
    slope, donors._slope = donors._slope, np.zeros_like(donors._slope)
    plain = donors.borrowed(networks.actor, start, 3, np.random.default_rng(1))
    rng = np.random.default_rng(1)
    picked = np.stack([donors._pick(row, at, 3, rng) for row, at in zip(start.row, start.at, strict=True)])
    for i, j in np.ndindex(picked.shape):
        own = donors._features[start.row[i], start.at[i]]
        gap = np.clip(own - donors._features[donors._row[picked[i, j]], donors._at[picked[i, j]]], -FURTHEST, FURTHEST)
        side = donors._side[start.row[i], start.at[i]] * (-1.0 if start.mirror[i] else 1.0)
        expected = np.einsum("f,fsc->sc", gap, slope[0])[np.arange(STEPS) // SECOND] * [1.0, side, 1.0, side]
        got = (adjusted - plain)[3 * i + j].flatten(1).detach().numpy()
        np.testing.assert_allclose(got, expected, atol=1e-5)


def test_residuals_beside_actors_that_do_not_learn_are_the_same_taken_once_or_each_time(interactions, networks) -> None:
    start = draw_moments(interactions, 6, STEPS, True, np.random.default_rng(0))
    frozen = Donors(interactions, STEPS, networks.actor), Donors(interactions, STEPS)
    once, each_time = (one.borrowed(networks.actor, start, 3, np.random.default_rng(1)) for one in frozen)
    torch.testing.assert_close(once, each_time, rtol=0.0, atol=1e-5)
    assert once.abs().max() > 0.1


def test_one_clip_alone_has_nobody_to_borrow_from(interactions, networks) -> None:
    rows = np.flatnonzero(interactions.clip == interactions.clip[0])
    alone = interactions.take(rows)
    start = draw_moments(alone, 2, STEPS, False, np.random.default_rng(0))
    with pytest.raises(InvalidInput, match="two clips or more"):
        Donors(alone, STEPS).borrowed(networks.actor, start, 2, np.random.default_rng(0))


def test_stage_1_keeps_residuals_of_all_near_misses_that_it_learned_from(tmp_path) -> None:
    table = synthetic_near_misses(40, 1).table
    weights = pretrain(table, CONFIG, SMALL, seed=1, out_dir=tmp_path)
    kept = weights.residuals()
    assert kept is not None
    assert weights.facts["data"]["people"] == table["source"].unique().to_list()
    assert 0 < len(kept.length) <= weights.facts["data"]["interactions"]
    again = pretrain(table, CONFIG, SMALL, seed=1, out_dir=tmp_path)
    assert again.digest() == weights.digest()


def test_objectives_that_keep_no_residuals_are_refused(tmp_path) -> None:
    with pytest.raises(InvalidInput, match="objective closed_loop keeps none"):
        pretrain(synthetic_near_misses(40, 1).table, PretrainConfig(episodes=1), SMALL, seed=1, out_dir=tmp_path)


def test_a_fitted_track_has_the_same_bits_however_many_threads_numpy_has():
    fits = []
    for threads in (1, 2):
        with threadpool_limits(threads, user_api="blas"):
            fits.append(_fit.__wrapped__(120))
    assert all(map(np.array_equal, *fits))
