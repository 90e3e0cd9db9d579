"""The command, the choice of episodes, and formats whose library is not there."""

import sys

import pytest
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.formats.exporters import Options, export


def test_the_command_writes_a_folder_for_each_format_and_says_where(own_bag, tmp_path):
    command = ["export", str(own_bag), "--to", "lanelet2,scenarionet", "-o", str(tmp_path / "out")]
    said = [f"written: {tmp_path}/out/lanelet2, 2 files", f"written: {tmp_path}/out/scenarionet, 5 files"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    assert result.output.splitlines() == said


def test_the_same_export_again_writes_what_was_damaged_and_another_one_is_refused(own_bag, tmp_path):
    out = tmp_path / "out"
    assert export(own_bag, ["lanelet2"], out) == {"lanelet2": 2}
    files = {path: path.read_bytes() for path in (out / "lanelet2").glob("*.osm")}
    record = out / "lanelet2" / "run.json"
    when = record.stat().st_mtime_ns
    assert export(own_bag, ["lanelet2"], out) == {"lanelet2": 2}
    assert record.stat().st_mtime_ns == when, "nothing was to be done"
    next(iter(files)).write_bytes(b"")
    assert export(own_bag, ["lanelet2"], out) == {"lanelet2": 2}
    assert {path: path.read_bytes() for path in (out / "lanelet2").glob("*.osm")} == files
    with pytest.raises(InvalidInput, match="choose another output folder"):
        export(own_bag, ["lanelet2"], out, episodes="4")


def test_a_file_of_another_is_never_deleted(own_bag, tmp_path):
    out, notes = tmp_path / "out", tmp_path / "out" / "lanelet2" / "deep" / "notes.txt"
    export(own_bag, ["lanelet2"], out)
    (out / "lanelet2" / ".unfinished").mkdir()  # of an export that was killed
    notes.parent.mkdir()
    notes.write_text("mine")
    next((out / "lanelet2").glob("*.osm")).write_bytes(b"")
    assert export(own_bag, ["lanelet2"], out) == {"lanelet2": 2}
    assert notes.read_text() == "mine"
    (out / "other").mkdir()
    with pytest.raises(InvalidInput, match="not empty: it holds other; choose another"):
        export(own_bag, ["lanelet2"], out)


def test_a_missing_library_is_named_with_the_command_that_installs_it(own_bag, tmp_path, monkeypatch):
    for name in [
        name for name in sys.modules if name.startswith(("vpsci_ros.extras.formats.open", "scenariogeneration"))
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "scenariogeneration", None)
    with pytest.raises(InvalidInput, match=r"needs scenariogeneration.*pip install .*'scenariogeneration"):
        export(own_bag, ["lanelet2", "openscenario"], tmp_path / "out")
    assert not (tmp_path / "out").exists(), "nothing is written before all libraries are found"


def test_an_unknown_format_vehicle_or_episode_is_refused_with_what_there_is(own_bag, tmp_path):
    with pytest.raises(InvalidInput, match="unknown format 'osm'; expected one of openscenario, commonroad, lanelet2"):
        export(own_bag, ["osm"], tmp_path / "out")
    with pytest.raises(InvalidInput, match="vehicle 'parked': expected controllable or trajectory"):
        export(own_bag, ["lanelet2"], tmp_path / "out", Options(vehicle="parked"))
    with pytest.raises(InvalidInput, match="no episode 77"):
        export(own_bag, ["lanelet2"], tmp_path / "out", episodes="4,77")
