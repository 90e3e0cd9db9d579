"""Intervals and paired tests agree with published or independently computed numbers."""

import math

import numpy as np
import pytest

from vpsci_ros.evaluation import statistics
from vpsci_ros.evaluation.statistics import (
    cluster_counts,
    interval,
    mcnemar,
    mean,
    resampled,
    resampled_difference,
    share,
    units_of,
    wilson_interval,
)


def test_wilsons_interval_of_ten_in_twenty_and_of_none_is_as_in_the_literature():
    # Newcombe, "Two-sided confidence intervals for the single proportion" (Statistics in Medicine 17, 1998), Table I,
    # method 3: 81/263, 15/148, 0/20, 1/29
    for hits, n, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611),
                               (1, 29, 0.0061, 0.1718), (29, 29, 0.8830, 1.0)):  # fmt: skip
        found = share(hits, n)
        assert found.value == hits / n
        assert (found.low, found.high) == (pytest.approx(low, abs=5e-5), pytest.approx(high, abs=5e-5))


def test_nothing_observed_gives_no_estimate():
    assert wilson_interval(0, 0) == (0.0, 1.0)
    assert np.isnan(interval([math.nan])).all()
    for found in (share(0, 0), resampled(np.empty(0), mean), statistics.share_difference(0, 0, 0)):
        assert math.isnan(found.value)
        assert found.n == 0


def test_mcnemars_test_is_the_two_sided_binomial_test_of_the_discordant_pairs():
    assert mcnemar(0, 0) == 1.0
    assert mcnemar(3, 3) == 1.0
    assert mcnemar(0, 5) == pytest.approx(2 / 2**5)
    assert mcnemar(9, 1) == pytest.approx(2 * (1 + 10) / 2**10)
    assert mcnemar(1, 9) == mcnemar(9, 1)


def test_the_paired_interval_is_that_of_agresti_and_min():
    # b = 10, c = 2 of n = 50 by hand: (10.5 - 2.5) / 52 = 0.153846; half = 1.959964 * sqrt(13 - 64 / 52) / 52
    found = statistics.share_difference(10, 2, 50)
    assert found.value == pytest.approx(0.16)
    half = 1.959964 * math.sqrt(13 - 64 / 52) / 52
    assert (found.low, found.high) == (pytest.approx(8 / 52 - half, abs=1e-6), pytest.approx(8 / 52 + half, abs=1e-6))


def test_the_units_that_a_difference_needs_are_connors() -> None:
    # d = 0.05, psi = 0.2 by hand: (1.959964 * 0.447214 + 0.841621 * sqrt(0.2 - 0.0025))^2 / 0.0025 = 625.55
    assert statistics.units_for_difference(0.05, 0.2) == 626
    # psi = d = 0.05: (1.959964 * 0.223607 + 0.841621 * sqrt(0.0475))^2 / 0.0025 = 154.7, also for a smaller psi
    assert statistics.units_for_difference(0.05, 0.05) == statistics.units_for_difference(0.05, 0.0) == 155
    for n in (5, 52, 104, 1000):
        for discordant in (0.0, 0.05, 0.2, 0.5):
            least = statistics.detectable_difference(n, discordant)
            assert statistics.units_for_difference(least * (1.0 + 1e-9), discordant) == n, "the inverse"
    assert math.isnan(statistics.detectable_difference(3, 0.2))


@pytest.mark.parametrize(("n", "discordant"), [(52, 0.2), (104, 0.1), (104, 0.3), (400, 0.05), (1000, 0.2)])
def test_a_detectable_difference_leaves_0_out_of_the_interval_in_four_of_five_samples(
    n: int, discordant: float
) -> None:
    least = statistics.detectable_difference(n, discordant)
    wide = max(discordant, least)
    cells = np.array([wide + least, wide - least, 2.0 - 2.0 * wide]) / 2.0
    samples = np.random.default_rng(1).multinomial(n, cells, 2000)
    shown = np.mean([statistics.share_difference(int(b), int(c), n).low > 0.0 for b, c, _ in samples])
    assert 0.78 < shown < 0.88, "standard error 0.009; the formula is cautious where few units differ"


def test_a_difference_that_a_mean_shows_is_that_of_its_interval() -> None:
    # half an interval is 1.959964 standard errors, and 1.959964 + 0.841621 of them show in 80%
    found = statistics.Estimate(0.1, 0.1 - 1.959964, 0.1 + 1.959964, 50)
    assert statistics.detectable_by_interval(found) == pytest.approx(1.959964 + 0.841621, abs=1e-5)


def test_the_bootstrap_of_a_mean_agrees_with_the_normal_interval():
    values = np.random.default_rng(3).normal(5.0, 2.0, 400)
    found = resampled(values, mean)
    error = values.std() / math.sqrt(400)
    assert found.value == pytest.approx(values.mean())
    assert found.low == pytest.approx(values.mean() - 1.96 * error, abs=0.15 * error)
    assert found.high == pytest.approx(values.mean() + 1.96 * error, abs=0.15 * error)
    assert resampled(values, mean) == found, "the same numbers, the same interval"


def test_pairs_are_resampled_as_pairs():
    first = np.random.default_rng(4).normal(0.0, 10.0, 200)
    found = resampled_difference(first + 1.0, first, mean)
    assert found.low == pytest.approx(1.0)
    assert found.high == pytest.approx(1.0)


@pytest.mark.parametrize("pairs", [0, 1])
def test_a_difference_of_fewer_than_two_pairs_is_not_known(pairs: int) -> None:
    found = resampled_difference(np.ones(pairs), np.zeros(pairs), mean)
    assert found.n == pairs
    assert [math.isnan(number) for number in found[:3]] == [True] * 3


def test_clusters_are_drawn_whole_and_as_often_as_there_are_clusters():
    clusters = np.array(["a", "b", "a", "c", "c", "c"])
    counts = cluster_counts(clusters, seed=1, count=50)
    assert (counts[:, 0] == counts[:, 2]).all()
    assert (counts[:, 3:] == counts[:, 3:4]).all()
    assert (counts[:, [0, 1, 3]].sum(axis=1) == 3).all()
    assert len({tuple(row) for row in counts}) > 5


def test_of_four_clips_clips_are_resampled_and_of_fewer_the_groups_in_them():
    clips, groups = np.array(["s/a", "s/b", "s/c", "s/d", "s/d"], object), np.array([0, 1, 2, 3, 4])
    several = units_of(clips, groups)
    assert (several.labels.tolist(), several.name, several.text) == (clips.tolist(), "clips", "4 clips")
    few = units_of(clips[1:], groups[1:])
    assert (few.labels.tolist(), few.text) == (["s/b 1", "s/c 2", "s/d 3", "s/d 4"], "4 groups")
    assert units_of(clips[3:], np.array([3, 3])).text == "1 group"
