"""Distances between distributions are those worked out by hand, and clips, not interactions, are resampled."""

import polars as pl
import pytest

from vpsci_ros.extras.paper.section_4.comparison import SCHEMA, describe, distance_between, onset_weights


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
