"""The same checks with CARLA's client 0.9.15, in a process of its own, as test/export does with the installed one."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from vpsci_ros.world.scenario import further_files, load_scenario, shipped_scenarios

pytest.importorskip("scenariogeneration", reason="pip install 'vpsci_ros[formats]'")

READ = """
import json, sys, carla
from pathlib import Path
found = {}
for path in map(Path, sys.argv[1:]):
    road = carla.Map(path.stem, path.read_text())
    ends = [point.transform.location for pair in road.get_topology() for point in pair]
    found[path.stem] = [[[c.x, -c.y] for c in road.get_crosswalks()], [[e.x, -e.y] for e in ends]]
print(json.dumps(found))
"""


def run(folder, program, *arguments):
    """Return what a program prints that imports the client in a folder."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    command = [sys.executable, "-W", "error", "-c", program, *map(str, arguments)]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=60, env=environment).stdout


def test_the_older_client_finds_lane_and_topology_and_the_crosswalk_within_what_it_moves_it(client_0_9_15, tmp_path):
    from vpsci_ros.extras.formats.opendrive import write_map

    scenarios = [*shipped_scenarios(), *map(load_scenario, further_files())]
    for scenario in scenarios:
        write_map(scenario, tmp_path / f"{scenario.name}.xodr")
    found = json.loads(run(client_0_9_15, READ, *sorted(tmp_path.glob("*.xodr"))))
    for scenario in scenarios:
        corners, ends = map(np.array, found[scenario.name])
        lane = scenario.vehicle.path
        assert lane.locate(*ends[0]) == pytest.approx((-60.0, 0.0), abs=0.05)
        assert lane.locate(*ends[1]) == pytest.approx((lane.length + 60.0, 0.0), abs=0.05)
        apart = np.linalg.norm(corners[:, None] - scenario.crosswalk, axis=2).min(axis=1)
        assert apart.max() < 2.2, "it mirrors outlines along their axis and moves them by a metre"
