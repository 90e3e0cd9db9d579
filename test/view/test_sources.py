"""Tables, datasets and bags become episodes that say the same as what they were read from; what is none is refused."""

import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.near_misses import write_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.encounters import generated_encounters, recorded_encounters
from vpsci_ros.view.episodes import FIELDS, Source, spread
from vpsci_ros.view.recorded import table_source
from vpsci_ros.view.sources import read_source, with_unique_keys


@pytest.fixture(scope="module")
def table_file(near_misses: pl.DataFrame, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "people.parquet"
    write_near_misses(near_misses, path)
    return path


def column(episode, name):
    return episode.values[:, FIELDS.index(name)]


def test_an_interaction_has_the_numbers_of_its_table(table_file: Path, near_misses: pl.DataFrame) -> None:
    source = read_source(table_file)
    assert (source.key, source.total, len(source.episodes)) == ("people", 16, 16)
    rows = near_misses.filter(pl.col("interaction") == int(source.episodes[3].name))
    for name, theirs in {"x": "veh_x", "heading": "veh_heading", "ped_vy": "ped_vy", "curvttc": "curvttc"}.items():
        np.testing.assert_array_equal(column(source.episodes[3], name), rows[theirs])


def test_who_yielded_in_recordings_is_what_the_report_says(near_misses: pl.DataFrame) -> None:
    encounters = recorded_encounters(near_misses)
    shown = table_source(near_misses, "people", 1000).episodes
    assert [e.yielded in ("vehicle", "both") for e in shown] == encounters["vehicle_yields"].to_list()
    assert ["conflict" in e.marks for e in shown] == encounters["conflict"].to_list()


def test_a_dataset_gives_its_kept_episodes_with_outcomes_and_yields(dataset: Path) -> None:
    source = read_source(dataset)
    kept = Dataset(dataset).index().filter(pl.col("reason") == "kept")
    assert [e.name for e in source.episodes] == [f"{s}:{c}" for s, c in kept.select("scenario", "count").rows()]
    assert [e.outcome for e in source.episodes] == kept["outcome"].to_list()
    assert [e.least for e in source.episodes] == kept["least_curvttc"].to_list()
    yields = generated_encounters(Dataset(dataset))
    assert [e.yielded == "vehicle" for e in source.episodes] == yields["vehicle_yields"].to_list()


def test_a_bag_gives_the_state_that_was_recorded(own_bag: Path) -> None:
    source = read_source(own_bag)
    assert [e.name for e in source.episodes] == ["1:0", "6:4", "1:2"]
    assert source.episodes[1].group.startswith("LocationB")
    first = source.episodes[0]
    steps = np.hypot(np.diff(column(first, "x")), np.diff(column(first, "y")))
    np.testing.assert_allclose(steps, column(first, "speed")[1:] * source.period, atol=0.02)


def test_wanted_episodes_are_found_by_name_and_a_missing_one_is_named(own_bag: Path, dataset: Path) -> None:
    assert [e.name for e in read_source(own_bag, wanted=["6:4"]).episodes] == ["6:4"]
    assert [e.name for e in read_source(dataset, wanted=["2:1"]).episodes] == ["2:1"]
    with pytest.raises(InvalidInput, match=r"no episode 9:9; it has 1:0, "):
        read_source(dataset, wanted=["9:9"])


def test_of_more_than_the_limit_evenly_spread_episodes_are_shown(table_file: Path) -> None:
    source = read_source(table_file, limit=4)
    assert ([e.name for e in source.episodes], source.total) == (["0", "5", "10", "15"], 16)
    assert len(spread(10**6, 1000)) == 1000


def test_sources_of_one_name_are_told_apart() -> None:
    twin = Source("a", "A", 0.1, [], 0)
    assert [s.key for s in with_unique_keys([twin, twin, twin])] == ["a", "a-2", "a-3"]


def test_what_is_no_source_is_refused_with_what_was_expected(
    tmp_path: Path, harmless_dataset: Path, near_misses: pl.DataFrame
) -> None:
    (tmp_path / "notes.txt").write_text("no table")
    near_misses.drop("curvttc").write_parquet(tmp_path / "short.parquet")
    for path, message in {
        tmp_path / "absent": "no such file or folder; expected a near-miss table",
        tmp_path / "notes.txt": "expected a near-miss table in Parquet, not readable",
        tmp_path / "short.parquet": "needs column curvttc",
        tmp_path: r"neither dataset\.json nor a bag in it",
        harmless_dataset: "holds no episode, so there is nothing to show",
    }.items():
        with pytest.raises(InvalidInput, match=message):
            read_source(path)


def test_a_bag_in_which_no_episode_ended_is_refused(own_bag: Path, tmp_path: Path) -> None:
    cut = shutil.copytree(own_bag, tmp_path / "cut")
    (mcap,) = cut.glob("*.mcap")
    mcap.write_bytes(mcap.read_bytes()[:3000])
    with pytest.raises(InvalidInput):
        read_source(cut)


def test_the_command_says_what_it_wrote(table_file: Path, dataset: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["view", str(dataset), str(table_file), "-o", str(tmp_path / "page.html")])
    assert result.exit_code == 0, result.output
    assert "people (recorded): 16 episodes" in result.output
    assert (tmp_path / "page.html").read_text(encoding="utf-8").startswith("<!doctype html>")


def test_the_command_refuses_an_episode_of_several_sources(table_file: Path, dataset: Path) -> None:
    result = CliRunner().invoke(app, ["view", str(dataset), str(table_file), "--episode", "1:0"])
    assert isinstance(result.exception, InvalidInput)
