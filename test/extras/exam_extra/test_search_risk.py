"""The count of failures: right on average, its interval covers, and nothing found is not taken for nothing there."""

import numpy as np
import pytest
from scipy.special import expit

from vpsci_ros.extras.exam_extra.search.plan import Plan
from vpsci_ros.extras.exam_extra.search.risk import Risk


def pool(seed, size=8_000):
    """Margins that spread as a rehearsal's do, and failures whose odds fall by e for each 8 cm of margin."""
    rng = np.random.default_rng(seed)
    margin = rng.gamma(2.0, 0.9, size) - 0.1
    return margin, rng.random(size) < expit(-1.0 - 12.0 * np.maximum(margin, -0.1))


def searched(seed, margin, failed, budget=600):
    plan = Plan(len(margin), budget, seed)
    for _, chosen, learns in plan.parts():
        plan.take(chosen, failed[chosen])
        if learns:
            plan.rehearsed(np.where(plan.driven, np.nan, margin))
    return plan


def test_the_interval_covers_the_failures_that_are_there():
    """Of 20 intervals at 95%, binomially distributed, fewer than 15 cover with a chance of 0.03%."""
    found = [
        (failed.sum(), searched(seed, margin, failed).count()) for seed in range(20) for margin, failed in [pool(seed)]
    ]
    covered = sum(count.failures_low <= truth <= count.failures_high for truth, count in found)
    assert covered >= 15
    ratio = np.mean([count.failures for _, count in found]) / np.mean([truth for truth, _ in found])
    assert ratio == pytest.approx(1.0, abs=0.15)


def test_it_drives_far_more_failures_than_episodes_at_random_would_hold():
    margin, failed = pool(0)
    plan = searched(0, margin, failed)
    assert plan.driven.sum() == 600
    assert plan.failed.sum() > 5 * 600 * failed.mean()


def test_nothing_found_leaves_an_upper_limit():
    margin, failed = pool(0)
    count = searched(0, margin, np.zeros_like(failed)).count()
    assert count.failures_low == 0.0
    assert 0.0 < count.rate_high < 0.003
    assert count.rate_low < 1e-4


def test_every_episode_driven_leaves_nothing_to_guess():
    failed = np.arange(100) < 7
    count = Risk(np.linspace(-0.2, 2.0, 100), failed).count(7, 100, np.zeros(0), np.random.default_rng(0))
    assert (count.failures, count.failures_low, count.failures_high) == (7.0, 7.0, 7.0)


def test_no_episode_is_driven_twice_and_the_same_seed_chooses_the_same():
    margin, failed = pool(1, 3000)
    first, second = (searched(5, margin, failed, 300) for _ in range(2))
    assert first.driven.sum() == 300
    np.testing.assert_array_equal(first.driven, second.driven)
    assert (searched(6, margin, failed, 300).driven != first.driven).any()
