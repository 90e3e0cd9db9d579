"""Tables, datasets and bags become episodes that say the same as what they were read from; what is none is refused."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.errors import InvalidInput
from vpsci_ros.view.episode_sources import read_source
from vpsci_ros.view.view_page import Source, with_unique_keys


def test_a_bag_and_chosen_episodes_of_it_are_shown(own_bag: Path) -> None:
    assert [each.episode.name for each in read_source(own_bag).episodes] == ["1:0", "6:4", "1:2"]
    one = read_source(own_bag, wanted=["6:4"])
    assert ([each.episode.name for each in one.episodes], one.total, one.title) == (["6:4"], 3, "bag (bag)")


def test_sources_of_one_name_get_different_names() -> None:
    twin = Source("a", "A", 0.1, [], 0)
    assert [s.key for s in with_unique_keys([twin, twin, twin])] == ["a", "a-2", "a-3"]


def test_a_dataset_of_which_no_episode_was_kept_is_refused(harmless_dataset: Path) -> None:
    with pytest.raises(InvalidInput, match="holds no episode, so there is nothing to show"):
        read_source(harmless_dataset)


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
