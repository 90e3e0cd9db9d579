"""Sources that a bank does not have, sizes of vehicles, and a bank known late."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.cli.dataset import generate
from vpsci_ros.cli.exam import ads_test
from vpsci_ros.cli.main import graph
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.onsets import find_onsets
from vpsci_ros.evaluation.simulators import known_late
from vpsci_ros.extras.drive.drive_command import drive
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.safety import VEHICLE_LENGTH, VEHICLE_WIDTH

STAGE_3 = Path("stage3_generate")


@pytest.mark.parametrize(
    "command",
    [generate, ads_test, partial(graph, params=STAGE_3), partial(drive, browser=False)],
    ids=["generate", "ads-test", "graph", "drive"],
)
def test_a_source_that_the_bank_does_not_have_is_refused_before_anything_runs(command: Any, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="expected one of cqut, vci, the sources of this bank, got 'nobody'"):
        command(output=tmp_path / "out", people="nobody")
    assert not list((tmp_path / "out").glob("*.json"))


def test_networks_have_no_sources_and_a_graph_says_so_before_it_starts(tmp_path: Path) -> None:
    networks = [f"{agent}_policy.weights=closed_loop" for agent in ("vehicle", "pedestrian")]
    with pytest.raises(InvalidInput, match="people: expected a bank for 'vci', got weights of networks"):
        graph(params=STAGE_3, output=tmp_path / "out", settings=networks, people="vci")


def test_a_named_source_is_that_of_both_agents_of_a_graph_and_of_the_pedestrian_whom_a_person_meets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Seen(Exception):
        pass

    def seen(sections: Sections, *_: Any, **__: Any) -> None:
        raise Seen({node: values["people"] for node, values in sections.values.items() if "people" in values})

    monkeypatch.setattr("vpsci_ros.nodes.graph.run_graph", seen)
    monkeypatch.setattr("vpsci_ros.extras.drive.person_exam.prepare_person", seen)
    with pytest.raises(Seen, match="^{'vehicle_policy': 'vci', 'pedestrian_policy': 'vci'}$"):
        graph(params=STAGE_3, output=tmp_path / "graph", people="vci")
    with pytest.raises(Seen, match="^{'pedestrian_policy': 'vci'}$"):
        drive(output=tmp_path / "drive", params=Path("drive"), people="vci")


def test_onsets_have_the_vehicles_of_the_table_whatever_its_source_is_called() -> None:
    table = synthetic_near_misses(interactions=4, seed=3).table
    named = table.with_columns(source=pl.lit("mine"), veh_length=pl.lit(5.5), veh_width=pl.lit(2.1))
    assert (find_onsets(named).size == [5.5, 2.1]).all()
    without = table.drop("veh_length", "veh_width")
    assert (find_onsets(without).size == [VEHICLE_LENGTH, VEHICLE_WIDTH]).all()  # of an unknown source


def test_a_bank_known_late_has_the_mean_of_the_four_steps_that_ended_two_before_the_situation_of_its_own_track() -> (
    None
):
    bank = load_policy("people")
    assert isinstance(bank, Bank)
    own, late = bank.of(), known_late(bank).of()
    long_before = np.flatnonzero(~np.isin(own.begin[:, None] - np.arange(7), own.end).any(axis=1) & (own.begin > 6))
    row = int(long_before[0])
    mean = own.steps[own.begin[row] - 6 : own.begin[row] - 2].mean(axis=0)
    np.testing.assert_allclose(late.before[row], mean)
    np.testing.assert_allclose(late.features[6, row] * late.scale[6], mean[0])
    first = np.flatnonzero(np.isin(own.begin, [0, *own.end]))
    assert first.size, "situations at the first step of a track"
    assert np.isnan(late.before[first]).all()
    assert np.isfinite(late.features).all()
