"""`vpsci safety compare`: agreement and lead times that follow by hand from made-up flags, and the printed whole."""

import io

import numpy as np
import pytest
from rich.console import Console
from synthetic import synthetic_near_misses

from vpsci_ros.data.near_misses import write_near_misses
from vpsci_ros.data.reference import around_critical
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.section_4 import measure_series, safety_compare
from vpsci_ros.extras.paper.section_4.measure_series import MEASURES, first_flags
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
    clips = np.array([0, 0, 1, 1, 2, 2])
    monkeypatch.setattr(safety_compare, "first_flags", lambda *_: (times, np.zeros(6, bool), clips))
    return safety_compare.agreement(None)


def test_the_share_is_of_the_columns_conflicts(known_flags):
    assert known_flags.share[0, 1] == 1.0  # all three of the center form's are seen by CurvTTC
    assert known_flags.share[1, 0] == 0.75
    assert np.isnan(known_flags.share[0, 2])  # nobody's conflicts cannot be shared
    assert known_flags.both[0, 1] == 3
    assert list(known_flags.conflicts[:3]) == [4, 3, 0]


def test_the_lead_is_how_much_earlier_the_row_flags(known_flags):
    assert known_flags.lead[0, 1] == 0.5  # median of 0.5, -1.0 and 1.0
    assert known_flags.lead[1, 0] == -0.5
    assert np.isnan(known_flags.lead[0, 2])


def test_the_intervals_hold_the_value_and_come_from_whole_clips(known_flags):
    low, high = known_flags.share_interval[1, 0]
    assert low <= 0.75 <= high
    assert low in (0.5, 0.75)  # what resamples of the three clips can give: clip 0 has 2 of 2, clip 1 has 1 of 2
    low, high = known_flags.lead_interval[0, 1]
    assert -0.25 <= low <= 0.5 <= high <= 1.0


def test_curvttc_flags_at_the_first_step_below_two_seconds(near_misses):
    times, _, _ = first_flags(near_misses)
    rows = around_critical(near_misses)  # times count from where these begin
    for k, part in enumerate(rows.partition_by("interaction", maintain_order=True)):
        below = np.flatnonzero(part["curvttc"].to_numpy() < CONFLICT_TTC)
        assert times[k, 0] == pytest.approx(below[0] * 0.1 if len(below) else np.inf)


def test_a_stricter_threshold_flags_fewer(near_misses, monkeypatch):
    counts = []
    for thresholds in ((4.0, 4.0, 1.0, 4.0), (1.0, 1.0, 6.0, 0.5)):
        for name, value in zip(("CONFLICT_TTC", "CLOSEST", "BRAKING", "ENCROACHMENT"), thresholds, strict=True):
            monkeypatch.setattr(measure_series, name, value)
        counts.append(safety_compare.agreement(near_misses).conflicts)
    loose, strict = counts
    assert (strict <= loose).all()
    assert (strict < loose)[:6].all()


def test_the_printed_whole_names_every_measure_and_every_number_of_interactions(near_misses, tmp_path):
    path = tmp_path / "near_misses.parquet"
    write_near_misses(near_misses, path)
    out = io.StringIO()
    safety_compare.compare(path, console=Console(file=out, width=120))
    assert "40 interactions of" in out.getvalue()
    assert all(name in out.getvalue() for name in MEASURES)


def test_a_file_that_is_no_near_miss_table_is_refused(tmp_path):
    with pytest.raises(InvalidInput, match="no such"):
        safety_compare.compare(tmp_path / "absent.parquet")
