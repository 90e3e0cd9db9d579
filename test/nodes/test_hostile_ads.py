"""A driving system that floods, hangs or answers late ends the exam with the right words and a report."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.exam.run import prepare, run_exam
from vpsci_ros.resources import params_dir

pytestmark = pytest.mark.usefixtures("forked_nodes")
HOSTILE = """
import sys, threading, time
import rclpy
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry

way, number, heard = sys.argv[1], float(sys.argv[2]), 0

def command(header=None):
    message = AccelStamped()
    if header is not None:
        message.header = header
    message.accel.linear.x = 0.5
    publisher.publish(message)

def on_odometry(odometry):
    global heard
    heard += 1
    if way == "hang" and heard > number:
        time.sleep(1000.0)
    if way == "late":
        time.sleep(number)
    command(odometry.header)

def flood():
    due, left = time.perf_counter(), 5.0
    while left > 0.0:  # or the recorder would go on with it for as long as it may
        due += 0.02
        left -= 0.02 * bool(heard)
        for _ in range(int(0.02 * number)):
            command()
        time.sleep(max(0.0, due - time.perf_counter()))

rclpy.init()
node = rclpy.create_node("hostile")
publisher = node.create_publisher(AccelStamped, "vehicle/cmd_accel", 1000)
node.create_subscription(Odometry, "vehicle/odometry", on_odometry, 10)
if way == "flood":
    threading.Thread(target=flood, daemon=True).start()
rclpy.spin(node)
"""


def examined(folder: Path, way: str, **world: Any) -> tuple[list[str], dict[str, Any]]:
    """Put the system to a short exam; return why it fails, and how the first run went by the report."""
    script = folder / "hostile.py"
    script.write_text(HOSTILE)
    short = {"scenarios": [1], "episodes": 2, "episode_time": 3.0} | world
    exam = {"pedestrians": ["walker"], "baseline": False, "silent_ticks": 5, "surplus_limit": 10}
    chosen = load(params_dir() / "ads_test.yaml").changed("world_simulator", short).changed("ads_test", exam)
    failures = run_exam(prepare(chosen, f"{sys.executable} {script} {way}"), folder / "exam", quiet=True)
    report = json.loads((folder / "exam" / "report.json").read_text())
    assert failures == report["failures"]
    assert (folder / "exam" / "report.html").is_file()
    return failures, report["conduct"]["alone"]


def test_one_that_floods_is_said_to_flood(domain: int, tmp_path: Path) -> None:
    # Ticks of 0.5 s by the wall clock, so that the flood is one on a fast machine, too.
    failures, conduct = examined(tmp_path, "flood 3000", real_time_factor=0.1)
    assert failures[0].startswith("nobody there: the ADS floods: ")
    assert conduct["commands_surplus"] > 1000 or "before the first tick" in failures[0]


def test_one_that_hangs_is_said_to_be_silent(domain: int, tmp_path: Path) -> None:
    failures, conduct = examined(tmp_path, "hang 20", action_timeout=0.3, episodes=20)
    assert "the ADS gave no usable command for" in failures[0]
    assert conduct["episodes_driven"] < 20


def test_one_that_answers_late_is_said_to_and_its_answers_are_refused(domain: int, tmp_path: Path) -> None:
    failures, conduct = examined(tmp_path, "late 0.5", action_timeout=0.2, episodes=20)
    assert "the ADS gave no usable command for" in failures[0]
    assert conduct["commands_refused"] > 0
    assert "that came were refused: late" in failures[0]
