"""A format of another distribution is written as the built-in ones are."""

from pathlib import Path

import polars as pl
from extending.page import Install, example
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.extras.formats.exporters import EXPORTERS
from vpsci_ros.view.episode_sources import read_episodes


def test_the_format_of_the_example_is_written_by_the_command(install: Install, own_bag: Path, tmp_path: Path) -> None:
    install(example("car_tracks"))
    assert EXPORTERS.names()[-1] == "car-tracks"
    done = CliRunner().invoke(app, ["export", str(own_bag), "--to", "car-tracks", "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    for episode in read_episodes(own_bag):
        rows = pl.read_csv(tmp_path / "out/car-tracks" / f"{episode.label}.csv")
        assert rows["x"].to_list() == [round(x, 3) for x in episode.x.tolist()]
