"""The launch files under ROS 2's own launch, where that is installed; PyPI does not have it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from vpsci_ros.bags.info import bag_info

pytest.importorskip("launch_ros", reason="ROS 2's launch is not installed; test/cli/test_launch_arguments.py stands in")
LAUNCH = Path(__file__).parents[2] / "launch"
SERVICE = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
service = LaunchService()
arguments = [tuple(text.split(":=")) for text in sys.argv[2:]]
source = PythonLaunchDescriptionSource(sys.argv[1])
service.include_launch_description(LaunchDescription([IncludeLaunchDescription(source, launch_arguments=arguments)]))
sys.exit(service.run())
"""


def launched(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    prefixes = f"{os.environ.get('AMENT_PREFIX_PATH', '')}:{sys.prefix}".strip(":")
    return subprocess.run(
        [sys.executable, "-c", SERVICE, LAUNCH / name, *arguments],
        env=os.environ | {"AMENT_PREFIX_PATH": prefixes},
        capture_output=True,
        text=True,
        timeout=240,
    )


def test_a_launched_stage_ends_with_status_0_and_leaves_its_bag(domain: int, tmp_path: Path) -> None:
    result = launched(
        "stage3_generate.launch.py", f"output:={tmp_path / 'out'}", "scenarios:=1,8", "episodes:=1", "batch:=2"
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert sorted(episode["name"] for episode in bag_info(tmp_path / "out/bag")["episodes"]) == ["1:0", "8:0"]


def test_the_example_ads_drives_under_launch(domain: int, tmp_path: Path) -> None:
    result = launched(
        "ads.launch.py", f"output:={tmp_path / 'out'}", "scenarios:=3", "episodes:=1", "real_time_factor:=0.0"
    )
    assert result.returncode == 0, result.stdout + result.stderr
    counts = {topic["name"]: topic["messages"] for topic in bag_info(tmp_path / "out/bag")["topics"]}
    assert counts["/vehicle/cmd_accel"] > 20
