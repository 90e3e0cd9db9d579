"""The proper score: best for the true distribution, learned in closed loop; stage 2 measures how far it departs."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch
from synthetic import synthetic_near_misses

from vpsci_ros.data.interactions import from_table
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import EnergyScoreConfig, ImitationConfig, PretrainConfig
from vpsci_ros.learning.energy_score import Likeness, draw_moments, sample
from vpsci_ros.learning.human_foresight import divergence
from vpsci_ros.learning.imitation import OBSERVED, recorded
from vpsci_ros.learning.likeness import energy_distance, energy_score, smoothed, smoothing, texture_distance
from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.actor import Distribution
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.world.observation import AGENTS

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, layers=1, latent=3, actor_hidden=[8, 8])
STEPS = 12
CONFIG = PretrainConfig(
    imitation=ImitationConfig(rollouts=8, rollout_steps=STEPS, learning_rate=3e-3, dropout=0.0),
    energy_score=EnergyScoreConfig(samples=4),
)


@pytest.fixture(scope="module")
def interactions():
    return from_table(synthetic_near_misses(40, 1).table)


def walks(count: int, samples: int, spread: float, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return spread * torch.randn(count, samples, 20, 2, generator=generator).cumsum(dim=2)


@pytest.mark.parametrize("wrong", [0.0, 0.5, 0.8, 1.25, 2.0])
def test_the_energy_score_prefers_the_true_spread(wrong: float) -> None:
    happened = walks(2000, 1, 1.0, 0)[:, 0]
    assert energy_score(walks(2000, 8, 1.0, 1), happened) < energy_score(walks(2000, 8, wrong, 1), happened)


def test_the_energy_score_of_roll_outs_that_agree_is_their_distance() -> None:
    happened = torch.zeros(3, 5, 2)
    sampled = torch.zeros(3, 4, 5, 2)
    sampled[..., 0] = 3.0
    sampled[..., 1] = 4.0
    assert float(energy_score(sampled, happened)) == pytest.approx(5.0, abs=1e-3)


def test_two_samples_of_one_distribution_have_less_energy_distance_than_of_two() -> None:
    generator = torch.Generator().manual_seed(1)
    first, second = (torch.randn(400, 6, generator=generator) for _ in range(2))
    wide = 1.5 * torch.randn(400, 6, generator=generator)
    assert energy_distance(second, first) < energy_distance(wide, first)


def test_texture_tells_bursts_from_noise_of_the_same_deviation() -> None:
    """Both have the same mean square of acceleration; one does nothing for nine tenths of the time."""
    generator = torch.Generator().manual_seed(2)

    def tracks(bursts: bool, count: int) -> torch.Tensor:
        push = torch.randn(count, 3, 1, generator=generator)
        if bursts:
            push = push * (torch.rand(count, 3, 1, generator=generator) < 0.1) * 0.1**-0.5
        along = push.repeat_interleave(10, dim=1)
        velocity = torch.cat([1.3 + 0.1 * along.cumsum(dim=1), torch.zeros_like(along)], dim=2)
        return smoothed(torch.cat([torch.zeros(count, 1, 2), 0.1 * velocity.cumsum(dim=1)], dim=1))

    people = tracks(True, 400)
    assert texture_distance(tracks(True, 400), people) < texture_distance(tracks(False, 400), people)


def test_smoothing_keeps_straight_lines() -> None:
    line = torch.stack([torch.arange(31.0), -2.0 * torch.arange(31.0)], dim=1)
    assert (smoothed(line[None])[0] - line).abs().max() < 1e-4
    assert float(smoothing(30).sum(dim=1).sub(1.0).abs().max()) < 1e-5


def test_roll_outs_begin_where_the_recording_was_and_then_differ(interactions) -> None:
    torch.manual_seed(0)
    networks, rng = Networks(SMALL), np.random.default_rng(0)
    start = draw_moments(interactions, 10, STEPS, True, rng)
    data = recorded(interactions, start, OBSERVED + STEPS + 1)
    with torch.no_grad():
        sampled = sample(networks.actor, data, start.at - start.begin, 3, STEPS, 0)
    assert torch.equal(sampled.motion[:, :, 0, :2], sampled.happened[:, None, 0, :2].expand(-1, 3, -1))
    assert (sampled.motion[:, 0, -1] - sampled.motion[:, 1, -1]).abs().max() > 0.05


@pytest.mark.parametrize("draws", ["noise of the network", "residuals of recorded people"])
def test_learning_brings_roll_outs_nearer_to_what_happened(monkeypatch, draws: str) -> None:
    monkeypatch.setattr("vpsci_ros.learning.energy_score.TEXTURE_WEIGHT", 0.0)
    recorded_people = draws == "residuals of recorded people"
    interactions = from_table(synthetic_near_misses(40, 1).table, whole_tracks=recorded_people)
    torch.manual_seed(0)
    networks = Networks(replace(SMALL, latent=0, residuals=True) if recorded_people else SMALL)
    networks.set_statistics(*interactions.samples(), 0.3)
    with torch.no_grad():
        for agent in AGENTS:
            networks.actor[agent].head[-1].weight.mul_(300.0)  # react wildly to what differs
    likeness = Likeness(networks, interactions, CONFIG)
    if likeness.donors:
        likeness.donors._slope[:] = 0.0  # adjusting leaves little of what differs to the networks

    def measured() -> float:
        with torch.no_grad():
            return float(np.mean([float(likeness.loss(np.random.default_rng(i))[0]) for i in range(3)]))

    before, optimiser = measured(), torch.optim.Adam(networks.actor.parameters(), 5e-3)
    rng = np.random.default_rng(1)
    for _ in range(30 if recorded_people else 12):
        optimiser.zero_grad()
        likeness.loss(rng)[0].backward()
        optimiser.step()
    assert measured() < 0.9 * before
    if not recorded_people:
        assert all(networks.actor[agent].persistence_logit.grad is not None for agent in AGENTS)


def test_who_does_as_in_stage_1_has_not_departed_and_who_does_not_has(interactions) -> None:
    was = Distribution(torch.zeros(2, 2), torch.full((2, 2), 0.5))
    assert divergence(copy.deepcopy(was), was).abs().max() < 1e-6
    assert (divergence(Distribution(was.mean + 1.0, was.scale), was) > 0.5).all()
    assert (divergence(Distribution(was.mean, 3.0 * was.scale), was) > 0.1).all()


def test_a_deterministic_network_is_refused(interactions) -> None:
    with pytest.raises(InvalidInput, match="latent = 0"):
        Likeness(Networks(NetworkConfig()), interactions, CONFIG)


def test_interactions_too_short_for_the_roll_outs_are_refused(interactions) -> None:
    with pytest.raises(InvalidInput, match="more than 999 steps"):
        draw_moments(interactions, 4, 999, True, np.random.default_rng(0))


def test_dropout_ends_with_an_update_that_fails(interactions) -> None:
    actors = Networks(SMALL).actor
    with pytest.raises(KeyboardInterrupt), actors.dropping_out(0.3):
        assert all(actors[agent].dropout == 0.3 for agent in AGENTS)
        raise KeyboardInterrupt
    assert all(actors[agent].dropout == 0.0 for agent in AGENTS)
