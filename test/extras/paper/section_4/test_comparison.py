"""Distances between distributions are those worked out by hand, and clips, not interactions, are resampled."""

import math

import polars as pl
import pytest

from vpsci_ros.extras.paper.section_4.bins import LEAST_IN_BIN, QUESTIONS, by_bins
from vpsci_ros.extras.paper.section_4.comparison import between_halves, describe, distance_between, onset_weights
from vpsci_ros.extras.paper.section_4.encounters import SCHEMA


def encounters(least: list[float], onset: list[float] | None = None, groups: list[str] | None = None) -> pl.DataFrame:
    """A table with these least CurvTTC; onsets at 4.9 s, groups one an interaction unless given."""
    n = len(least)
    values = {name: [0.0] * n if kind == pl.Float64 else [False] * n for name, kind in SCHEMA.items()}
    values |= {"least_curvttc": least, "onset_curvttc": onset or [4.9] * n}
    values["group"] = groups or [f"{i}" for i in range(n)]
    values["conflict"] = [value < 2.0 for value in least]
    return pl.DataFrame(values, schema=SCHEMA)


def test_a_shift_by_a_second_is_a_wasserstein_distance_of_a_second():
    """Every value moves by 1 s; the distribution functions of 1, 2, 3, 4 and 2, 3, 4, 5 differ by one value of four."""
    found = distance_between(encounters([1.0, 2.0, 3.0, 4.0]), encounters([5.0, 4.0, 3.0, 2.0]))
    assert found["ks"]["value"] == pytest.approx(0.25)
    assert found["wasserstein"]["value"] == pytest.approx(1.0)


def test_weighting_by_onset_takes_away_a_difference_that_is_one_of_onset_alone():
    """Half of the recorded begin at 2 s and come to 1 s, all of the generated do: weighted, the two are the same."""
    recorded = encounters([1.0, 1.2, 3.0, 3.2], onset=[2.0, 2.0, 4.9, 4.9])
    generated = encounters([1.0, 1.2], onset=[2.0, 2.0])
    assert onset_weights(recorded, generated).tolist() == [0.5, 0.5, 0.0, 0.0]
    found = distance_between(recorded, generated)
    assert found["ks"]["value"] == pytest.approx(0.5)
    assert found["ks_onset"] == pytest.approx(0.0, abs=1e-12)
    assert found["wasserstein_onset"] == pytest.approx(0.0, abs=1e-12)


def test_intervals_of_a_few_clips_are_wide_however_many_interactions_these_have():
    """Four clips, two of conflicts only: resampled, the share is one of quarters; by interaction it is 46 to 54%."""
    table = encounters([1.0] * 300 + [3.0] * 300, groups=[f"{i // 150}" for i in range(600)])
    clips, rows = (describe(table, clustered=c)["conflict"] for c in (True, False))
    assert clips["value"] == rows["value"] == 0.5
    assert (clips["low"], clips["high"]) == pytest.approx((0.0, 1.0))
    assert 0.45 < rows["low"] < 0.48 < 0.52 < rows["high"] < 0.55


def test_a_share_of_none_or_all_has_the_interval_of_that_many_units():
    """Wilson's of 0 in n ends at z^2 / (n + z^2), that of n in n begins at n / (n + z^2); six rows, two clips."""
    table, z2 = encounters([1.0] * 6, groups=["a", "b"] * 3), 1.959964**2
    rows, clips = (describe(table, clustered=c) for c in (False, True))
    assert [(found["conflict"]["low"], found["conflict"]["high"]) for found in (rows, clips)] == [
        pytest.approx((n / (n + z2), 1.0)) for n in (6, 2)
    ]
    assert rows["vehicle_yields"] == {"value": 0.0, "low": 0.0, "high": pytest.approx(z2 / (6 + z2))}


def test_two_clips_differ_by_the_distance_between_them_and_one_clip_by_nothing_known():
    """Either clip is one half: 1, 1 and 2, 2 differ by the whole distribution function and by 1 s, in every draw."""
    found = between_halves(encounters([1.0, 1.0, 2.0, 2.0], groups=["a", "a", "b", "b"]))
    assert found == {name: {"value": 1.0, "low": 1.0, "high": 1.0} for name in ("ks", "wasserstein")}
    alone = between_halves(encounters([1.0, 2.0], groups=["a", "a"]))
    assert all(math.isnan(value) for estimate in alone.values() for value in estimate.values())


def of_speed(speeds: list[float], conflict: list[bool]) -> pl.DataFrame:
    """Encounters in which the vehicle drives at these speeds [m/s]."""
    least = [1.0 if each else 3.0 for each in conflict]
    return encounters(least).with_columns(vehicle_speed=pl.Series(speeds))


CONFLICTS_BY_VEHICLE = QUESTIONS[0].name


def test_a_share_by_speed_counts_the_interactions_of_its_bin_and_says_nothing_of_a_few():
    """15 of 60 at 0.5 m/s, all of 20 at 1 m/s, which belongs to the next bin, and nine at 5 m/s, too few to tell."""
    speeds = [0.5] * 60 + [1.0] * 20 + [5.0] * (LEAST_IN_BIN - 1)
    conflict = [True] * 15 + [False] * 45 + [True] * 20 + [True] * (LEAST_IN_BIN - 1)
    slow, next_, *_, fast = by_bins(of_speed(speeds, conflict), clustered=False)[CONFLICTS_BY_VEHICLE]
    assert (slow["n"], slow["value"]) == (60, 0.25)
    assert 0.10 < slow["low"] < 0.20 < 0.30 < slow["high"] < 0.40  # 0.25 +- 2 sqrt(0.25 * 0.75 / 60) = 0.14 to 0.36
    assert (next_["n"], next_["value"], next_["high"]) == (20, 1.0, 1.0)
    assert next_["low"] == pytest.approx(20 / (20 + 1.96**2), abs=1e-3)  # Wilson's: n / (n + z^2)
    assert fast == {"n": LEAST_IN_BIN - 1, "value": None, "low": None, "high": None}
