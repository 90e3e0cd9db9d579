"""`vpsci doctor`: which extras are installed, what each is for, and whether the ROS 2 middleware works here."""

import importlib.metadata
import os
import platform
import re
import sys
from pathlib import Path

from vpsci_ros.errors import not_installed

BRINGS = {
    "learn": "stages 1 and 2, `evaluate`",
    "ros": "nodes, graphs and the demo: ROS 2 Jazzy",
    "messages": "the build of vpsci_msgs",
    "rl": "Gymnasium and PettingZoo environments",
    "exam-extra": "`ads-search`: rare failures",
    "paper": "`realism`, `study` and `turing`",
    "formats": "`export` to OpenSCENARIO, OSI and MP4",
    "commonroad": "`export` to CommonRoad (apart: another protobuf)",
    "carla": "episodes in a CARLA server",
    "drive": "`drive`",
    "cluster": "`--cluster`: work on several machines",
    "planner": "examples/motion_planner.py",
    "sumo": "examples/sumo_crossing.py",
    "highway": "examples/highway_crossing.py",
    "baselines": "examples/trained_policy.py",
    "test": "the tests",
    "docs": "the documentation site",
    "colcon": "a build by colcon",
}


def doctor() -> None:
    """Print which extras are installed and what each is for, the kernel cache's size, and whether ROS 2 works here.

    Exit status 1 where no message arrives.
    """
    print(f"vpsci_ros {importlib.metadata.version('vpsci_ros')}, Python {platform.python_version()}, "
          f"{len(os.sched_getaffinity(0))} cores, {sys.prefix}\n")  # fmt: skip
    for extra, wanted in _extras().items():
        missing = [name for name in wanted if not list(importlib.metadata.Distribution.discover(name=name))]
        state = "missing  " if missing else "installed"
        print(f"  {extra:11s} {state}  {BRINGS.get(extra, '')}")
        if missing and len(missing) < len(wanted):
            print(f"{'':25s}lacks {', '.join(missing)}")
    print("\nto add one: pip install -c constraints.txt '.[NAME]' in the repository")
    folder, size = kernel_cache()
    print(f"compiled kernels: {size / 1e6:.0f} MB in {folder}; delete the folder to free it")
    try:
        from vpsci_ros.nodes.self_test import exchange

        print(f"ROS 2: a node received its own message after {exchange():.1f} s")
    except ModuleNotFoundError as error:
        print(f"ROS 2: {not_installed((error.name or '').partition('.')[0]) or error}")


def kernel_cache() -> tuple[Path, int]:
    """Return the default folder of compiled kernels, and its size [bytes]."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vpsci_ros"
    return folder, sum(path.lstat().st_size for path in folder.rglob("*"))


def _extras() -> dict[str, list[str]]:
    """Return extra -> names of the Python packages that it installs."""
    found: dict[str, list[str]] = {
        name: [] for name in importlib.metadata.metadata("vpsci_ros").get_all("Provides-Extra") or ()
    }
    for line in importlib.metadata.requires("vpsci_ros") or ():
        extra = re.search(r"""extra == ["']([\w-]+)["']""", line)
        if extra:
            found[extra[1]].append(re.split(r"[\s<>=!~;\[(]", line)[0])
    return found
