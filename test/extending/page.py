"""The files that docs/extending.md shows, and a graph with what they add."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from vpsci_ros.resources import params_dir

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"
_FILE = re.compile(r"^`(?P<name>[\w.]+)`:\n\n```\w+\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
Install = Callable[[dict[str, str]], Path]


def files_of(heading: str) -> dict[str, str]:
    """Return the files that a section of the page shows: name -> text."""
    section = re.search(rf"^## {heading}\n(.*?)(?=^## |\Z)", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert section is not None, f"no section {heading!r} in {PAGE}"
    return {match["name"]: match["text"] for match in _FILE.finditer(section[1])}


def run_graph_with(settings: list[str], folder: Path) -> Path:
    """Run stage 3's graph in processes of its own, two episodes side by side, with these settings; return its bag."""
    small = ["world_simulator.episodes=2", "world_simulator.batch=2", "world_simulator.action_timeout=60.0"]
    words = [word for setting in (*small, *settings) for word in ("--set", setting)]
    params = str(params_dir() / "stage3_generate.yaml")
    command = [sys.executable, "-m", "vpsci_ros.cli", "graph", "--params", params, "-q", "-o", str(folder)]
    subprocess.run([*command, *words], check=True, timeout=240)
    return folder / "bag"
