"""The authors' files, written here by the layout that they publish, read as what they are made from."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS, TABLE_7, agent_ids
from vpsci_ros.data.importers.layout_file import read_layout_file
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.published_tables import canonical, convert
from vpsci_ros.view.episode_sources import open_source, read_episodes

BAGS = [Path(__file__).parents[3] / "bags" / name for name in ("LocationA_PedCross_S-N", "LocationB_PedCross_N-S")]


@pytest.fixture(scope="session")
def published(tmp_path_factory):
    """A folder as the authors publish it: Table 6's names, Table 7's columns, y down; of the episodes of two bags."""
    folder = tmp_path_factory.mktemp("published")
    for bag in BAGS:
        (episode,) = read_episodes(bag)
        published_rows(episode).write_csv(folder / f"{bag.name}.csv")
    return folder


def published_rows(episode):
    """Return an episode of one pedestrian in the columns of Table 7, y down."""
    count = np.full(len(episode), episode.number)
    veh_id, ped_id = agent_ids(np.full(len(episode), episode.key[0]), count, np.zeros(len(episode), np.int64))
    table = {"count": count, "frame": np.arange(len(episode)), "veh_id": veh_id, "ped_id": ped_id,
             "distance": episode.distance[0], "CurvTTC": episode.curvttc[0]}  # fmt: skip
    walker = episode.ped_x[0], episode.ped_y[0], episode.ped_vx[0], episode.ped_vy[0]
    for end, motion in (("av", (episode.x, episode.y, episode.vx, episode.vy)), ("ped", walker)):
        x, y, vx, vy = motion
        table |= {f"position_x_{end}": x, f"position_y_{end}": -y, f"velocity_x_{end}": vx, f"velocity_y_{end}": -vy}
    return pl.DataFrame(table).select(pl.col(name).cast(EPISODE_COLUMNS[name].dtype) for name in TABLE_7)


@pytest.fixture
def changed(published, tmp_path):
    """Return the function that writes one of the files with columns changed, and returns the folder."""

    def write(**change):
        table = pl.read_csv(published / "LocationA_PedCross_S-N.csv").with_columns(**change)
        table.write_csv(tmp_path / "LocationA_PedCross_S-N.csv")
        return tmp_path

    return write


def test_published_files_hold_the_episodes_that_they_were_written_from(published, tmp_path):
    made = {episode.name: episode for bag in BAGS for episode in read_episodes(bag)}
    convert(published, tmp_path / "out")
    source = open_source(tmp_path / "out")
    assert source.period == 0.05
    assert source.kind == "generated"
    read = list(source.read())
    assert [episode.name for episode in read] == list(made)
    for episode in read:
        own = made[episode.name]
        for name in ("x", "y", "heading", "speed"):
            moving = own.speed > 0.1
            assert getattr(episode, name)[moving] == pytest.approx(getattr(own, name)[moving], abs=2e-3), name
        assert episode.ped_y == pytest.approx(own.ped_y, abs=1e-4)
        assert episode.least_curvttc == pytest.approx(own.least_curvttc, abs=1e-4)
        assert episode.scenario is not None, "the tracks lie on the lane of Table 6's scenario"
        assert episode.outcome == "none"


def test_y_is_taken_from_the_right_turns_and_not_assumed(published, changed):
    north = changed(
        **{name: -pl.col(name) for name in ("position_y_av", "velocity_y_av", "position_y_ped", "velocity_y_ped")}
    )
    name = "LocationA_PedCross_S-N.csv"
    assert canonical(north / name).equals(canonical(published / name))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({f"velocity_{axis}_av": pl.col(f"velocity_{axis}_av") * 3.6 for axis in "xy"}, "0.278 times as fast"),
        ({"distance": pl.col("distance") + 2.0}, "column distance is 2.00 m off"),
        ({"frame": pl.col("frame") // 2}, "line 2: frame 0 of episode [0-9]+ comes twice"),
        ({"CurvTTC": pl.lit(-1.0)}, "line 2, column CurvTTC: expected a time"),
        ({f"velocity_{axis}_av": pl.lit(0.0) for axis in "xy"}, "turns by 0.00 rad; expected right turns"),
    ],
)  # fmt: skip
def test_a_file_that_contradicts_the_layout_is_refused(changed, change, said):
    with pytest.raises(InvalidInput, match=said):
        canonical(changed(**change) / "LocationA_PedCross_S-N.csv")


def test_view_and_import_take_what_the_files_become(published, tmp_path):
    data = str(tmp_path / "data")
    for command in (
        ["published", str(published), "-o", data],
        ["view", data, "-o", str(tmp_path / "view.html")],
        ["import", str(published), "--format", "vpsci", "-o", str(tmp_path / "near.parquet")],
    ):
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 0, result.output
    near = pl.read_parquet(tmp_path / "near.parquet")
    made = {episode.label.rpartition("_")[0]: episode for bag in BAGS for episode in read_episodes(bag)}
    assert set(near["clip"]) == {f"{name}/{episode.number}" for name, episode in made.items()}
    number = made["LocationA_PedCross_S-N"].number
    own = near.filter(clip=f"LocationA_PedCross_S-N/{number}")
    (episode,) = read_episodes(data, [f"1:{number}"])
    assert own["veh_x"].to_numpy() == pytest.approx(episode.x[::2], abs=1e-4)
    assert own["veh_heading"].to_numpy() == pytest.approx(episode.heading[::2], abs=1e-3)
    assert own["curvttc"].min() == pytest.approx(episode.least_curvttc, abs=0.3)  # at every second frame


def test_the_layout_of_hdi_reads_boxes_in_pixels_and_speeds_in_km_h():
    """What these keys do: test_described_layouts.py."""
    keys = read_layout_file(Path(__file__).parents[3] / "examples/layouts/hdi.yaml")
    (layout,) = keys.layouts
    assert keys.source == "hdi"
    assert {"x_min", "y_min", "x_max", "y_max", "speed"} < set(layout.columns)
    assert (layout.metres, layout.frame_rate, layout.y_down, layout.speed) == (0.05, 30.0, True, pytest.approx(1 / 3.6))
