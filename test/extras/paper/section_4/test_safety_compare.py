"""`vpsci safety compare`: agreement and lead times that follow by hand from made-up flags, and the printed whole."""

import numpy as np
import polars as pl
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.data.corpus import around_critical
from vpsci_ros.evaluation.statistics import Units
from vpsci_ros.extras.paper.section_4 import safety_compare
from vpsci_ros.extras.paper.section_4.safety_compare import MEASURES, first_flags
from vpsci_ros.safety import CONFLICT_TTC


@pytest.fixture(scope="module")
def near_misses():
    return synthetic_near_misses(40, seed=3).table


@pytest.fixture
def known_flags(monkeypatch):
    """Six interactions of three clips; CurvTTC sees four conflicts, the center form three, the others none."""
    times = np.full((6, len(MEASURES)), np.inf)
    times[:4, 0] = [1.0, 2.0, 3.0, 4.0]
    times[:3, 1] = [1.5, 1.0, 4.0]
    units = Units(np.array(["a", "a", "b", "b", "c", "c"]), "clips")
    monkeypatch.setattr(safety_compare, "first_flags", lambda *_: (times, np.zeros(6, bool), units))
    return safety_compare.agreement(None)


def test_the_share_is_of_the_columns_conflicts(known_flags):
    assert known_flags.share[0, 1] == 1.0  # all three of the center form's are seen by CurvTTC
    assert known_flags.share[1, 0] == 0.75
    assert np.isnan(known_flags.share[0, 2])  # nobody's conflicts cannot be shared
    assert known_flags.both[0, 1] == 3
    assert list(known_flags.conflicts[:3]) == [4, 3, 0]
    assert known_flags.units == "3 clips"


def test_curvttc_flags_at_the_first_step_below_two_seconds(near_misses):
    times, _, _ = first_flags(near_misses)
    rows = around_critical(near_misses)  # times count from where these begin
    for k, part in enumerate(rows.partition_by("interaction", maintain_order=True)):
        below = np.flatnonzero(part["curvttc"].to_numpy() < CONFLICT_TTC)
        assert times[k, 0] == pytest.approx(below[0] * 0.1 if len(below) else np.inf)


def test_the_flags_of_one_recording_are_resampled_by_vehicle(near_misses):
    """Resampled by the clip, the only one, the interval of each share would be the share itself."""
    ten = near_misses.filter(pl.col("interaction") < 10).with_columns(clip=pl.lit("long"))
    found = safety_compare.agreement(ten)
    assert found.units == "10 groups"
    inside = (found.share[0] > 0.0) & (found.share[0] < 1.0)  # of each measure's conflicts those that CurvTTC flags
    assert inside.any()
    assert (found.share_interval[inside, 0, 0] < found.share[0, inside]).all()
