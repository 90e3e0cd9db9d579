"""A driver or a spawn of the world is a file and a row of a table, from which all others take its name."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.exam import DRIVERS
from vpsci_ros.world import WorldConfig
from vpsci_ros.world.drivers import PEDESTRIAN_DRIVERS, VEHICLE_DRIVERS
from vpsci_ros.world.spawns import SPAWNS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "extending.md").read_text("utf-8")
HALTS = 10.0  # [m] from the car, the pedestrian that the page shows
RUN = """
import json
import numpy as np
from vpsci_ros.envs.simulation import PEDESTRIANS
from vpsci_ros.exam.exam import DRIVERS, title_of
from vpsci_ros.world import RUNNING, World, WorldConfig, load_scenarios
from vpsci_ros.world.tick import NO_ACTIONS
config = WorldConfig(spawn="from_rest", vehicle_driver="autopilot", pedestrian_driver="halting")
world = World(config, load_scenarios([1]), [(1, episode) for episode in range(20)], 20, 1)
far, frames = np.full(20, np.inf), []
while not world.done:
    before = world.state.copy()
    world.advance(world.now.assessed(far, far, np.zeros(20, bool)), NO_ACTIONS)
    frames.append((before, world.state.copy()))
before, after = (np.concatenate(states) for states in zip(*frames))
running = (before["status"] == RUNNING) & (after["status"] == RUNNING)
near = np.hypot(before["vehicle_x"] - before["pedestrian_x"], before["vehicle_y"] - before["pedestrian_y"]) < 10.0
speed = np.hypot(after["pedestrian_vx"], after["pedestrian_vy"])
print(json.dumps({
    "start": before["vehicle_speed"][running & (before["frame"] == 0)].tolist(),
    "near": speed[running & near].tolist(),
    "far": speed[running & ~near].tolist(),
    "names": ["halting" in PEDESTRIANS, DRIVERS["halting"], title_of("halting")],
}))
"""


@pytest.mark.timeout(600)  # it compiles the kernels of a world with two more of them
def test_the_driver_and_the_spawn_of_the_page_are_a_file_and_a_row_each(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "vpsci_ros", tmp_path / "vpsci_ros", ignore=shutil.ignore_patterns("extras", "__pycache__"))
    for name in ("package.xml", "params", "msg_defs", "urdf"):
        (tmp_path / name).symlink_to(ROOT / name)
    files = re.findall(r"^`(vpsci_ros/\S+)`:\n\n```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    for name, text in files:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        table = path.with_name("__init__.py")
        (row,) = re.findall(rf'^\w+\("{path.stem}".*\)$', PAGE, re.MULTILINE)
        module = ".".join(Path(name).parent.parts)
        added = f"from {module} import {path.stem}\n\nTABLE = (\n    {row},\n"
        table.write_text(table.read_text("utf-8").replace("\nTABLE = (\n", f"\n{added}"), encoding="utf-8")
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment |= {"PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", RUN], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert seen["start"] == [0.0] * 20
    assert max(seen["near"]) < 1e-9
    assert max(seen["far"]) > 1.0
    assert seen["names"] == [True, "halting", "halting"]


@pytest.mark.parametrize(
    ("page", "names"),
    [("world.md", [*SPAWNS, *VEHICLE_DRIVERS, *PEDESTRIAN_DRIVERS]), ("ads.md", DRIVERS)],
)
def test_the_pages_tables_name_each_of_them(page: str, names: list[str]) -> None:
    cells = re.findall(r"^\| (`[^|]*) \|", (ROOT / "docs" / page).read_text("utf-8"), re.MULTILINE)
    named = {name for cell in cells for name in re.findall(r"`(\w+)`", cell)}
    assert set(names) <= named


@pytest.mark.parametrize(
    ("name", "known"),
    [("spawn", SPAWNS), ("vehicle_driver", VEHICLE_DRIVERS), ("pedestrian_driver", PEDESTRIAN_DRIVERS)],
)
def test_a_name_without_a_row_is_refused_with_those_that_have_one(name: str, known: dict[str, int]) -> None:
    with pytest.raises(InvalidInput, match=f"{name} = 'ghost' is unknown; expected one of {', '.join(known)}"):
        WorldConfig(**{name: "ghost"})
