"""A scenario file of one's own runs in generate, nodes and view; what they leave needs the file no more."""

import shutil
from pathlib import Path

import polars as pl
import pytest
import yaml
from composed import composed
from extending.page import midblock
from typer.testing import CliRunner

from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.cli.main import app
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.bag import record_episodes
from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.nodes.graph import resolve
from vpsci_ros.resources import params_dir
from vpsci_ros.view.episode_sources import read_source
from vpsci_ros.view.view_page import packed
from vpsci_ros.world import load_scenarios

STRAIGHT = """<OpenDRIVE><road id="1" length="80" junction="-1">
<planView><geometry s="0" x="0" y="0" hdg="0" length="80"><line/></geometry></planView>
<lanes><laneSection s="0">
<left><lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>
<right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>
</laneSection></lanes>
<objects><object id="7" type="crosswalk" s="40" t="0" hdg="0"><outline>
<cornerLocal u="-1.5" v="-5"/><cornerLocal u="1.5" v="-5"/><cornerLocal u="1.5" v="5"/><cornerLocal u="-1.5" v="5"/>
</outline></object></objects>
</road></OpenDRIVE>"""
MIDBLOCK = midblock()


PICKED = {
    "number": 42,
    "name": "picked",
    "location": "straight",
    "opendrive": "straight.xodr",
    "vehicle": {"lanes": [[1, -1]], "spawn": [10, 18], "goal": 60},
    "pedestrian": {"crosswalk": 7, "arrival": [2, 5]},
}
NUMBERS = [41, 42]


def make(folder: Path, files: Path) -> None:
    """Make a dataset and a run of the page's file, and of a route of a map; the files are gone then."""
    files.mkdir()
    (files / "straight.xodr").write_text(STRAIGHT, encoding="utf-8")
    (files / "picked.yaml").write_text(yaml.safe_dump(PICKED), encoding="utf-8")
    (files / "midblock.yaml").write_text(MIDBLOCK, encoding="utf-8")
    settings = [f"world_simulator.scenarios={NUMBERS}", "world_simulator.episodes=1", "world_simulator.batch=2",
                f"world_simulator.scenario_files=[{files / 'picked.yaml'}, {files / 'midblock.yaml'}]"]  # fmt: skip
    words = ["--params", str(params_dir() / "stage3_generate.yaml"), "--episodes", "3", "--workers", "1", "-q"]
    words += [word for setting in settings for word in ("--set", setting)]
    done = CliRunner().invoke(app, ["generate", *words, "-o", str(folder / "set")])
    assert done.exit_code == 0, done.output
    chosen = [*settings, "world_simulator.episodes=2", "world_simulator.action_timeout=60.0"]
    with own_domain(), composed(resolve(load(params_dir() / "stage3_generate.yaml", chosen), folder / "run")):
        pass
    shutil.rmtree(files)


def test_what_they_leave_is_verified_recorded_and_drawn_without_the_files(tmp_path: Path) -> None:
    make(tmp_path, tmp_path / "files")
    data = Dataset(tmp_path / "set")
    assert {"midblock", "picked"} == set(data.scenarios)
    checked = CliRunner().invoke(app, ["dataset", "verify", str(tmp_path / "set"), "--workers", "1"])
    assert checked.exit_code == 0, checked.output
    (number, *_) = data.index().filter(pl.col("scenario") == 41).get_column("count").to_list()
    assert record_episodes(tmp_path / "set", [(41, number)], tmp_path / "bag") > 20
    assert verify_bag(tmp_path / "bag", weights="people").difference == ""
    assert verify_bag(tmp_path / "run" / "bag").difference == ""
    for left in ("set", "run/bag"):
        source = read_source(tmp_path / left)
        groups = {each.episode.key[0]: each.episode.group for each in source.episodes}
        assert sorted(groups) == NUMBERS
        assert (groups[41], groups[42]) == ("midblock", "picked")
        grounds = packed(source)["grounds"]
        assert sorted(grounds) == NUMBERS
        assert grounds[41]["lane"][0] == [0.0, 0.0]


@pytest.mark.parametrize(
    ("old", "new", "scenarios", "message"),
    [
        ("number: 41", "number: 3", [3], "number 3 is that of the package's own .*; choose one from 9 to 255"),
        ("", "", [1], r"scenario_files holds midblock with number 41, but scenarios = \[1\] does not name 41"),
        ("name: midblock", "name: ../midblock", [41], "name becomes that of files.*got '../midblock'"),
    ],
)
def test_a_file_that_cannot_be_chosen_is_refused_with_what_to_do(
    tmp_path: Path, old: str, new: str, scenarios: list[int], message: str
) -> None:
    written = tmp_path / "midblock.yaml"
    written.write_text(MIDBLOCK.replace(old, new) if old else MIDBLOCK, encoding="utf-8")
    with pytest.raises(InvalidInput, match=message):
        load_scenarios(scenarios, [written])
