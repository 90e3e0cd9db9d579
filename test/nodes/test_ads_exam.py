"""The exam end to end: the graph of nodes, a driving system as a process, and a report that tells what happened."""

import json
import sys
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from class_in_process import class_in_process

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.conduct import run_exam
from vpsci_ros.exam.exam import prepare
from vpsci_ros.exam.result import read_result
from vpsci_ros.exam.run import run_with
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.run_config import Sections

pytestmark = pytest.mark.usefixtures("forked_nodes")
ODD = """
import os, sys
import rclpy
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry

answered = 0

def on_odometry(odometry):
    global answered
    answered += 1
    if "die" in sys.argv and answered > 10:
        print("out of memory", flush=True)
        os._exit(3)
    values = [float("nan"), float("inf"), 1e9] if "wrong" in sys.argv else []
    stamps = [odometry.header.stamp] * len(values)
    if "flood" in sys.argv:
        values, stamps = [*values, *[0.5] * 20], [*stamps, *[odometry.header.stamp] * 20]
    good = [] if "only" in sys.argv else [0.5]
    for value, stamp in zip(values + good, stamps + [odometry.header.stamp]):
        message = AccelStamped()
        message.header.stamp = stamp
        message.accel.linear.x = value
        command.publish(message)

rclpy.init()
node = rclpy.create_node("odd_ads")
command = node.create_publisher(AccelStamped, "vehicle/cmd_accel", 1000)
node.create_subscription(Odometry, "vehicle/odometry", on_odometry, 1000)
rclpy.spin(node)
"""


@pytest.fixture
def odd(tmp_path: Path) -> str:
    """A command that starts a driving system which misbehaves as its arguments say."""
    script = tmp_path / "odd_ads.py"
    script.write_text(ODD)
    return f"{sys.executable} {script}"


def sections(**exam: Any) -> Sections:
    found = load(params_dir() / "ads_test.yaml")
    world = {"scenarios": [1], "episodes": 2, "episode_time": 2.0, "action_timeout": 30.0}
    exam = {"pedestrians": ["walker"], "baseline": False, "allow_standing": True} | exam
    return found.changed("world_simulator", world).changed("ads_test", exam)


def read(folder: Path) -> tuple[dict[str, Any], str]:
    return json.loads((folder / "report.json").read_text()), (folder / "report.html").read_text()


def test_an_exam_leaves_episodes_report_and_provenance_and_those_of_its_class(domain: int, tmp_path: Path) -> None:
    folder = tmp_path / "exam"
    chosen = sections(pedestrians=["learned"], baseline=True)
    assert run_exam(prepare(chosen), folder, ["collision_rate > 1", "ticks_unanswered > 0"], quiet=True) == []

    table = pl.read_parquet(folder / "episodes.parquet")
    groups = table.group_by("driver", "pedestrian").len().sort("driver", "pedestrian").rows()
    assert groups == [("ads", "alone", 2), ("ads", "learned", 2), ("autopilot", "learned", 2)]
    assert table["duration"].max() <= 2.0
    assert table["time_lost"].is_nan().all(), "nobody arrives in two seconds"
    report, page = read(folder)
    assert report["conduct"]["learned"]["commands_refused"] == 0
    assert len(report["exam"]["weights_sha256"]) == 64
    assert report["exam"]["ads_files_sha256"].keys() == {"example_ads.py", "example_driver.py"}
    assert "<b>Passed</b>" in page

    require_the_same_of_its_class(chosen, folder, tmp_path / "class")


def require_the_same_of_its_class(chosen: Sections, folder: Path, other: Path) -> None:
    """Require that the example's class, examined without ROS, has the node's table and report, number by number."""
    with class_in_process():
        run_exam(prepare(chosen, ads_class="vpsci_ros.nodes.example_driver:ExampleDriver"), other, quiet=True)
    assert pl.read_parquet(other / "episodes.parquet").equals(pl.read_parquet(folder / "episodes.parquet"))
    by_class, by_node = (read(each)[0] for each in (other, folder))
    kept = by_node.keys() - {"exam", "criteria", "failures"}
    assert {name: by_class[name] for name in kept} == {name: by_node[name] for name in kept}


def test_an_ads_that_dies_fails_the_exam_and_the_report_says_with_what(domain: int, tmp_path: Path, odd: str) -> None:
    failures = run_exam(prepare(sections(), f"{odd} die"), tmp_path / "exam", quiet=True)
    assert len(failures) == 1, "it never drove an episode, which is found out once"
    assert "the ADS ended with exit status 3, having said 'out of memory'" in failures[0]
    report, page = read(tmp_path / "exam")
    assert report["conduct"]["alone"]["episodes_driven"] == 0
    assert "out of memory" in page


def test_what_a_flooding_ads_sends_wrongly_is_refused_and_counted_and_the_exam_goes_on(
    domain: int, tmp_path: Path, odd: str
) -> None:
    run_with(prepare(sections(), f"{odd} wrong flood"), "walker", tmp_path / "exam")
    found = read_result(tmp_path / "exam", "walker")
    assert len(found.episodes) == 2
    assert found.conduct.refused >= 3 * 10
    assert (found.conduct.failure, found.unanswered) == ("", {})


def test_bad_input_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    for exam, criteria, said in (
        ({}, ["colision_rate > 0"], "unknown measure"),
        ({"recorded": str(tmp_path / "none.parquet")}, [], "no such file"),
        ({"ads": "no_such_program"}, [], "no program 'no_such_program'"),
    ):
        with pytest.raises(InvalidInput, match=said):
            run_exam(prepare(sections(**exam)), tmp_path / "exam", criteria, quiet=True)
    with pytest.raises(InvalidInput, match="holds the first pedestrian only"):
        prepare(sections().changed("world_simulator", {"pedestrians": 3}))
    assert prepare(sections(perception=True).changed("world_simulator", {"pedestrians": 3})).world.pedestrians == 3
    assert not (tmp_path / "exam").exists()
