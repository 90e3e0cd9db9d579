"""tools/make_bags.py: which episode of a scenario it records, and that it leaves only small bags that verify."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from vpsci_ros.bags.info import bag_info
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.runs.sections import Sections
from vpsci_ros.world.state import COLLISION, ENDED, EPISODE, GOAL, RUNNING

WORLD = {"vehicle_driver": "autopilot", "pedestrian_driver": "autopilot", "scenarios": [1], "seed": 3}
SECTIONS = Sections({"graph": {"nodes": ["world_simulator", "safety_monitor", "recorder"]}, "world_simulator": WORLD})


@pytest.fixture
def make_bags(tool: Callable[[str], ModuleType]) -> ModuleType:
    return tool("make_bags")


def test_it_records_a_long_critical_episode_that_ended_well_with_the_least_curvttc_nearest_to_1_5_s(
    make_bags: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = np.zeros(5, EPISODE)
    state["episode"], state["status"] = range(5), RUNNING
    state["outcome"] = [COLLISION, GOAL, GOAL, GOAL, GOAL]
    state["least_curvttc"] = [1.5, 1.5, 1.875, 1.25, 2.0]
    last = state.copy()
    last["status"] = ENDED
    long = SimpleNamespace(critical=np.array([1, 0, 1, 1, 1]))
    none = SimpleNamespace(critical=np.zeros(5))
    steps = [SimpleNamespace(tick=SimpleNamespace(state=state), assessment=long)] * make_bags.LONG
    steps.append(SimpleNamespace(tick=SimpleNamespace(state=last), assessment=none))
    loop = SimpleNamespace(loop=lambda queue: steps)
    monkeypatch.setattr(make_bags, "Simulator", lambda job, batch: loop)
    assert make_bags.telling_episode(SECTIONS, 1, 5) == (3, "goal", 1.25), "0 collides, 1 is critical for too short"


def test_a_bag_is_recorded_by_the_graph_and_verified_and_a_larger_one_is_an_error(
    domain: int,
    make_bags: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(make_bags, "sections_of", lambda given: SECTIONS)
    monkeypatch.setattr(sys, "argv", ["make_bags.py", "--output", str(tmp_path / "bags"), "--look", "4"])
    assert make_bags.main() == 0, capsys.readouterr().err
    (bag,) = (tmp_path / "bags").iterdir()
    (episode,) = bag_info(bag)["episodes"]
    result = verify_bag(bag)
    assert (result.difference, result.uncompared, result.episodes) == ("", (), 1)
    said = capsys.readouterr().out
    assert said.startswith(f"{bag.name}: episode 1:{episode['episode']}, ")
    assert f"least CurvTTC {episode['least_curvttc']:.2f} s, {result.ticks} ticks verified" in said

    kept = shutil.copytree(bag, tmp_path / "kept")
    monkeypatch.setattr(make_bags, "record", lambda sections, number, bag: shutil.copytree(kept, bag))
    monkeypatch.setattr(make_bags, "LARGEST", 1000)
    assert make_bags.main() == 1
    assert "bytes, expected at most 1000" in capsys.readouterr().err
