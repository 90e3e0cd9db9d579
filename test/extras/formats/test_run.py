"""The command, the choice of episodes, and formats whose library is not there."""

import sys

import polars as pl
import pytest
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS, TABLE_7
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.formats.run import Options, export


def test_the_command_writes_a_folder_for_each_format_and_says_where(own_bag, tmp_path):
    command = ["export", str(own_bag), "--to", "carla-csv,scenarionet", "-o", str(tmp_path / "out")]
    said = [f"written: {tmp_path}/out/carla-csv, 2 files", f"written: {tmp_path}/out/scenarionet, 5 files"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    assert result.output.splitlines() == said


def test_the_same_export_again_writes_what_was_damaged_and_another_one_is_refused(own_bag, tmp_path):
    out = tmp_path / "out"
    assert export(own_bag, ["carla-csv"], out) == {"carla-csv": 2}
    files = {path: path.read_bytes() for path in (out / "carla-csv").glob("*.csv")}
    record = out / "carla-csv" / "run.json"
    when = record.stat().st_mtime_ns
    assert export(own_bag, ["carla-csv"], out) == {"carla-csv": 2}
    assert record.stat().st_mtime_ns == when, "nothing was to be done"
    next(iter(files)).write_bytes(b"")
    assert export(own_bag, ["carla-csv"], out) == {"carla-csv": 2}
    assert {path: path.read_bytes() for path in (out / "carla-csv").glob("*.csv")} == files
    with pytest.raises(InvalidInput, match="choose another output folder"):
        export(own_bag, ["carla-csv"], out, episodes="4")


def test_a_missing_library_is_named_with_the_command_that_installs_it(own_bag, tmp_path, monkeypatch):
    for name in [
        name for name in sys.modules if name.startswith(("vpsci_ros.extras.formats.open", "scenariogeneration"))
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "scenariogeneration", None)
    with pytest.raises(InvalidInput, match=r"needs scenariogeneration.*pip install .*'scenariogeneration"):
        export(own_bag, ["carla-csv", "openscenario"], tmp_path / "out")
    assert not (tmp_path / "out").exists(), "nothing is written before all libraries are found"


def test_an_unknown_format_vehicle_or_episode_is_refused_with_what_there_is(own_bag, tmp_path):
    with pytest.raises(InvalidInput, match="unknown format 'osm'; expected one of openscenario, commonroad, lanelet2"):
        export(own_bag, ["osm"], tmp_path / "out")
    with pytest.raises(InvalidInput, match="vehicle 'parked': expected controllable or trajectory"):
        export(own_bag, ["carla-csv"], tmp_path / "out", Options(vehicle="parked"))
    with pytest.raises(InvalidInput, match="no episode 77"):
        export(own_bag, ["carla-csv"], tmp_path / "out", episodes="4,77")


def test_carla_csv_is_the_datasets_table_with_y_negated(dataset, tmp_path):
    export(dataset, ["carla-csv"], tmp_path / "out")
    for name, counts in Dataset(dataset).scenarios.items():
        path = tmp_path / "out/carla-csv" / f"{name}.csv"
        assert path.is_file() == bool(counts["kept"])
        if path.is_file():
            theirs = pl.read_csv(path, schema={column: EPISODE_COLUMNS[column].dtype for column in TABLE_7})
            ours = Dataset(dataset).rows(name).select(TABLE_7)
            y = [column for column in ours.columns if "_y_" in column]
            assert len(y) == 4
            same = [column for column in ours.columns if column not in (*y, "distance")]
            assert theirs.select(same).equals(ours.select(same))
            assert theirs.select(y).equals(ours.select(-pl.col(column) for column in y))
            assert theirs["distance"].to_numpy() == pytest.approx(ours["distance"].to_numpy(), abs=1e-4)
