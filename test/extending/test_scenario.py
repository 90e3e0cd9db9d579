"""A scenario file of one's own runs in generate, nodes, exam and view; what they leave needs the file no more."""

from pathlib import Path

import pytest
import yaml
from extending.page import files_of, run_graph_with
from typer.testing import CliRunner

from vpsci_ros.bags.plot import save_episode
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.cli.main import app
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.run import prepare, read_exam, run_exam
from vpsci_ros.generate.record import record_episodes
from vpsci_ros.resources import params_dir
from vpsci_ros.view.pack import packed
from vpsci_ros.view.sources import read_source
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
MIDBLOCK = files_of("Add a scenario")["midblock.yaml"]


@pytest.fixture
def midblock(tmp_path: Path) -> Path:
    """The page's file."""
    path = tmp_path / "midblock.yaml"
    path.write_text(MIDBLOCK, encoding="utf-8")
    return path


def chosen(midblock: Path) -> list[str]:
    """Return the two settings that choose the scenario."""
    return ["world_simulator.scenarios=[41]", f"world_simulator.scenario_files=[{midblock}]"]


def test_a_dataset_of_it_is_verified_and_recorded_without_the_file(midblock: Path, tmp_path: Path) -> None:
    folder, bag = tmp_path / "set", tmp_path / "bag"
    params = str(params_dir() / "stage3_generate.yaml")
    words = ["generate", "--params", params, "--episodes", "3", "--workers", "1", "-q"]
    for setting in chosen(midblock):
        words += ["--set", setting]
    done = CliRunner().invoke(app, [*words, "-o", str(folder)])
    assert done.exit_code == 0, done.output
    assert list(Dataset(folder).scenarios) == ["midblock"]
    midblock.unlink()
    checked = CliRunner().invoke(app, ["dataset", "verify", str(folder), "--workers", "1"])
    assert checked.exit_code == 0, checked.output
    numbers = Dataset(folder).index().get_column("count").to_list()
    assert record_episodes(folder, [(41, numbers[0])], bag) > 20
    assert verify_bag(bag, weights="refined").difference == ""
    save_episode(bag, f"41:{numbers[0]}", tmp_path / "episode.png")
    for left in (folder, bag):
        source = read_source(left)
        assert source.episodes[0].episode.group == "midblock"
        assert packed(source)["grounds"][41]["lane"][0] == [0.0, 0.0]


def test_the_graph_of_nodes_runs_it_and_its_bag_is_verified_without_the_file(
    midblock: Path, domain: int, tmp_path: Path
) -> None:
    bag = run_graph_with(chosen(midblock), tmp_path / "run")
    midblock.unlink()
    assert verify_bag(bag).difference == ""


def test_the_exam_takes_place_there(midblock: Path, domain: int, tmp_path: Path) -> None:
    settings = [*chosen(midblock), "world_simulator.episodes=1", "world_simulator.episode_time=3.0",
                "world_simulator.action_timeout=30.0", "ads_test.pedestrians=[walker]"]  # fmt: skip
    assert run_exam(prepare(load(params_dir() / "ads_test.yaml", settings)), tmp_path / "exam", quiet=True) == []
    assert "midblock" in (tmp_path / "exam" / "exam.json").read_text(encoding="utf-8")
    sources = read_exam(tmp_path / "exam", 10)
    assert [(source.key, source.episodes[0].episode.group) for source in sources] == [
        ("ads-walker", "midblock"), ("autopilot-walker", "midblock")
    ]  # fmt: skip
    assert all(41 in packed(source)["grounds"] for source in sources)


def route_of_a_map(folder: Path) -> list[str]:
    """Write a scenario whose lane and crosswalk are picked from a map, and return the settings that choose it."""
    (folder / "straight.xodr").write_text(STRAIGHT, encoding="utf-8")
    document = {
        "number": 42,
        "name": "picked",
        "location": "straight",
        "opendrive": "straight.xodr",
        "vehicle": {"lanes": [[1, -1]], "spawn": [10, 18], "goal": 60},
        "pedestrian": {"crosswalk": 7, "arrival": [2, 5]},
    }
    (folder / "picked.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    return ["world_simulator.scenarios=[42]", f"world_simulator.scenario_files=[{folder / 'picked.yaml'}]"]


@pytest.mark.parametrize("which", ["the package's further ones", "a route of a map"])
def test_further_scenarios_and_routes_of_a_map_go_through_generate_graph_and_view(
    which: str, domain: int, tmp_path: Path
) -> None:
    settings = (
        route_of_a_map(tmp_path) if which == "a route of a map" else ["world_simulator.scenarios=[101,102,103,104]"]
    )
    numbers = {42} if which == "a route of a map" else {101, 102, 103, 104}
    words = [word for setting in settings for word in ("--set", setting)]
    words += ["--params", str(params_dir() / "stage3_generate.yaml"), "--episodes", "2", "--workers", "1", "-q"]
    done = CliRunner().invoke(app, ["generate", *words, "-o", f"{tmp_path}/set"])
    assert done.exit_code == 0, done.output
    bag = run_graph_with(settings, tmp_path / "run")
    assert verify_bag(bag).difference == ""
    for source in (read_source(tmp_path / "set"), read_source(bag)):
        assert {each.episode.key[0] for each in source.episodes} == numbers
        assert set(packed(source)["grounds"]) == numbers


@pytest.mark.parametrize(
    ("old", "new", "scenarios", "message"),
    [
        ("number: 41", "number: 3", [3], "number 3 is that of the package's own .*; choose one from 9 to 255"),
        ("", "", [1], r"scenario_files holds midblock with number 41, but scenarios = \[1\] does not name 41"),
        ("name: midblock", "name: ../midblock", [41], "name becomes that of files.*got '../midblock'"),
    ],
)
def test_a_file_that_cannot_be_chosen_is_refused_with_what_to_do(
    midblock: Path, old: str, new: str, scenarios: list[int], message: str
) -> None:
    midblock.write_text(MIDBLOCK.replace(old, new) if old else MIDBLOCK, encoding="utf-8")
    with pytest.raises(InvalidInput, match=message):
        load_scenarios(scenarios, [midblock])
