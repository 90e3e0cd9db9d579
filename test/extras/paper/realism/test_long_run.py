"""What becomes of an interaction in the long run: who stands, sets off again, brakes, and how long it is critical."""

import numpy as np
import polars as pl
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.extras.paper.realism.long_run import course, long_run


def track(**columns: object) -> np.ndarray:
    rows = {"drive": 5.0, "walk": 1.0, "ttc": 4.0, "apart": 2.0} | columns
    return np.stack([np.broadcast_to(np.asarray(value, float), 40) for value in rows.values()], axis=1)


def test_a_spell_that_ends_and_begins_again_is_a_second_one_and_clear_is_after_the_last() -> None:
    ttc = np.full(40, 9.0)
    ttc[0:5] = 4.0
    once = course(track(ttc=ttc))
    assert (once["second_spell"], once["clear_after_s"]) == (0.0, pytest.approx(0.5))
    ttc[10:12] = 4.9  # after 0.5 s: a flicker
    assert course(track(ttc=ttc))["second_spell"] == 0.0
    ttc[10] = 9.0
    ttc[11:13] = 4.9
    twice = course(track(ttc=ttc))
    assert (twice["second_spell"], twice["clear_after_s"]) == (1.0, pytest.approx(1.3))


def test_who_stands_is_counted_for_as_long_and_sets_off_again_only_afterwards() -> None:
    walk = np.r_[np.full(10, 1.2), np.full(12, 0.1), np.full(18, 1.0)]
    found = course(track(walk=walk))
    assert (found["pedestrian_stands"], found["pedestrian_sets_off_again"]) == (1.0, 1.0)
    assert found["pedestrian_stands_for_s"] == pytest.approx(1.2)
    assert course(track(walk=np.where(np.arange(40) < 10, 1.2, 0.1)))["pedestrian_sets_off_again"] == 0.0
    never = course(track())
    assert never["vehicle_stands"] == 0.0
    assert np.isnan(never["vehicle_sets_off_again"])


def test_braking_is_the_mean_over_half_a_second() -> None:
    # 1.4 m/s lost within 0.5 s are 2.8 m/s2, 1.6 are 3.2
    for lost, hard in ((1.4, 0.0), (1.6, 1.0)):
        drive = 5.0 - lost * np.clip((np.arange(40) - 10) / 5.0, 0.0, 1.0)
        assert course(track(drive=drive))["vehicle_brakes_hard"] == hard


def test_generated_interactions_are_watched_as_long_as_recorded_ones() -> None:
    table = synthetic_near_misses(interactions=12, seed=3).table
    short = table.filter(pl.int_range(pl.len()).over("interaction") < 45)
    found = long_run(short, table, 0)
    assert found["generated"]["watched_s_median"][0] <= 4.5
    same = long_run(table, table.with_columns(clip=pl.lit("1")), 0)
    for name, (value, low, high) in same["recorded"].items():
        assert np.isnan(value) or low <= value <= high, name
    clear = "clear_after_s_median"
    one = long_run(table.with_columns(clip=pl.lit("1")), table, 0)["recorded"]
    assert one[clear][1] < one[clear][2], "of one clip the groups are resampled"
