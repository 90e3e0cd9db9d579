"""The code passes the linter, and its core the strict type checker, which `make check` runs on the whole package."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The core needs neither, and to read torch, which the rooms above import, is half of mypy's time.
ABOVE = """
[[tool.mypy.overrides]]
module = ["torch.*", "vpsci_ros.cosim.*", "vpsci_ros.exam.*"]
follow_imports = "skip"
"""


def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True, timeout=300)


def test_ruff_finds_nothing():
    result = run("ruff", "check", "--output-format=concise", ".")
    assert result.returncode == 0, result.stdout + result.stderr


def test_mypy_finds_nothing_in_the_core(tmp_path):
    settings = tmp_path / "settings.toml"
    settings.write_text((ROOT / "pyproject.toml").read_text() + ABOVE)
    rooms = [word for room in ("safety", "world") for word in ("-p", f"vpsci_ros.{room}")]
    result = run("mypy", "--no-error-summary", "--config-file", settings, *rooms)
    assert result.returncode == 0, result.stdout + result.stderr
