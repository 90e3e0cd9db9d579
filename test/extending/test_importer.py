"""An importer of another distribution works as the built-in ones do; one that is broken is named with its owner."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from extending.page import Install, example
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.data.importers import IMPORTERS, import_trajectories
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.errors import InvalidInput

CAMERA = example("camera_tracks")


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    """A car along x at 5 m/s; somebody crosses 20 m ahead at 1.2 m/s, and is in its way when it comes."""
    t = np.arange(40) * 0.1
    frame = np.arange(40)
    car = pl.DataFrame({"frame": frame, "id": 7, "kind": "car", "x": 5.0 * t, "y": 0.0, "heading": 0.0})
    car = car.with_columns(vx=pl.lit(5.0), vy=pl.lit(0.0))
    person = pl.DataFrame({"frame": frame, "id": 3, "kind": "person", "x": 20.0, "y": 1.2 * (t - 4.0), "heading": 0.0})
    person = person.with_columns(vx=pl.lit(0.0), vy=pl.lit(1.2))
    folder = tmp_path / "recordings"
    folder.mkdir()
    pl.concat([car, person]).write_csv(folder / "morning.csv")
    return folder


def test_the_importer_of_the_example_finds_a_near_miss_by_the_command(install: Install, recordings: Path) -> None:
    install(CAMERA)
    table = recordings.parent / "near_misses.parquet"
    done = CliRunner().invoke(app, ["import", str(recordings), "--format", "camera", "-o", str(table)])
    assert done.exit_code == 0, done.output
    rows = read_near_misses(table)
    # The front, 2.3 m ahead of the centre, reaches the person's line, 0.3 m before x = 20 m, at 5 m/s.
    assert rows["curvttc"][0] == pytest.approx((20.0 - 0.3 - 2.3) / 5.0, abs=1e-3)
    assert rows.select("source", "clip", "veh_id", "ped_id").row(0) == ("camera", "morning", 7, 3)
    assert rows.select("veh_length", "veh_width").row(0) == (4.6, 1.85)


def renamed(distribution: str, points: str) -> dict[str, str]:
    """The example under another distribution's name and with these lines as entry points."""
    text = CAMERA["pyproject.toml"].replace("camera-tracks", distribution)
    return CAMERA | {"pyproject.toml": text.replace('camera = "camera_tracks:CAMERA"', points)}


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ('broken = "no_such_module:IT"', "entry point broken = no_such_module:IT of .*: ModuleNotFoundError"),
        (
            'broken = "camera_tracks:read"',
            r"entry point broken .*: expected an instance of .*tracks\.Importer, got <function read",
        ),
    ],
)
def test_an_addition_that_cannot_be_used_is_named_with_its_distribution(
    install: Install, recordings: Path, points: str, message: str
) -> None:
    install(renamed("camera-broken", points))
    with pytest.raises(InvalidInput, match="package camera-broken, " + message):
        import_trajectories(recordings, "broken")


def test_a_distribution_that_takes_a_built_in_name_is_refused(install: Install) -> None:
    install(renamed("camera-thief", 'described = "camera_tracks:CAMERA"'))
    with pytest.raises(InvalidInput, match="package camera-thief adds format 'described', which is built in"):
        IMPORTERS.names()
