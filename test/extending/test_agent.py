"""A pedestrian of another distribution acts in process, through the graph of nodes and in the exam."""

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from class_in_process import class_in_process
from composed import composed
from extending.page import Install, example, midblock

from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.conduct import run_exam
from vpsci_ros.exam.exam import prepare
from vpsci_ros.exam.view import read_exam
from vpsci_ros.generate.job import job_from
from vpsci_ros.nodes.graph import resolve
from vpsci_ros.policy.agent_types import make_agent
from vpsci_ros.policy.policy_config import PolicyConfig
from vpsci_ros.resources import params_dir
from vpsci_ros.view.view_page import packed
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop

pytestmark = pytest.mark.usefixtures("forked_nodes")
FREEZING = example("freezing")


def test_the_pedestrian_of_the_example_stands_within_two_seconds_of_the_hand_over(install: Install) -> None:
    install(FREEZING)
    config = WorldConfig(vehicle_driver="autopilot")
    world = World(config, load_scenarios([1]), [(1, episode) for episode in range(40)], 40, 1)
    agents = {"pedestrian": make_agent("pedestrian", PolicyConfig(agent="freezing"))}
    since, speeds = np.zeros(40), []
    for step in Loop(world, agents=agents):
        state = step.tick.state
        since = np.where(state["controlled"] == 1, since + config.tick, 0.0)
        speeds += list(np.hypot(state["pedestrian_vx"], state["pedestrian_vy"])[since > 2.0])
    # Velocity falls by exp(-4 * 0.5 * t), (21)-(24): after 2 s to 2% of 4 m/s at most.
    assert len(speeds) > 100
    assert max(speeds) < 0.1


def test_it_meets_a_driving_system_in_the_exam_on_a_scenario_of_ones_own(install: Install, tmp_path: Path) -> None:
    install(FREEZING)
    (tmp_path / "midblock.yaml").write_text(midblock(), encoding="utf-8")
    settings = ["world_simulator.scenarios=[41]", f"world_simulator.scenario_files=[{tmp_path / 'midblock.yaml'}]",
                "world_simulator.episodes=2", "world_simulator.episode_time=4.0", "ads_test.allow_standing=true",
                "ads_test.pedestrians=[freezing]",
                "ads_test.ads_class=vpsci_ros.nodes.example_driver:ExampleDriver"]  # fmt: skip
    with class_in_process():
        assert run_exam(prepare(load(params_dir() / "ads_test.yaml", settings)), tmp_path / "exam", quiet=True) == []
    report = json.loads((tmp_path / "exam" / "report.json").read_text(encoding="utf-8"))
    assert set(report["drivers"]["ads"]) == {"freezing"}
    assert report["exam"]["agents"] == {"freezing": "freezing 1.0"}
    assert "freezing" in (tmp_path / "exam" / "report.html").read_text(encoding="utf-8")
    sources = read_exam(tmp_path / "exam", 10)
    assert [(source.key, source.episodes[0].episode.group) for source in sources] == [
        ("ads-freezing", "midblock"), ("autopilot-freezing", "midblock")
    ]  # fmt: skip
    assert all(41 in packed(source)["grounds"] for source in sources)


def test_a_graph_with_it_is_verified_from_its_bag(install: Install, domain: int, tmp_path: Path) -> None:
    install(FREEZING)
    settings = ["pedestrian_policy.agent=freezing", "pedestrian_policy.weights=''", "world_simulator.scenarios=[1]",
                "world_simulator.episodes=2", "world_simulator.batch=2"]  # fmt: skip
    with composed(resolve(load(params_dir() / "stage3_generate.yaml", settings), tmp_path)):
        pass
    result = verify_bag(tmp_path / "bag")
    assert (result.difference, result.episodes) == ("", 2)


def test_it_walks_in_the_gymnasium_environment_and_generate_refuses_it_by_name(install: Install) -> None:
    install(FREEZING)
    env = gymnasium.make("vpsci_ros.envs:vpsci_ros/RightTurn-v0", pedestrian="freezing")
    env.reset(seed=1)
    seen = [env.step(np.zeros(2, np.float32))[0] for _ in range(40)]
    assert np.isfinite(seen).all()
    sections = load(params_dir() / "stage3_generate.yaml", ["pedestrian_policy.agent=freezing"])
    with pytest.raises(InvalidInput, match="pedestrian_policy.agent = freezing: a dataset is made by a bank"):
        job_from(sections)
    with pytest.raises(InvalidInput, match="pedestrian = 'frozen': expected one of .*social_force, freezing"):
        gymnasium.make("vpsci_ros.envs:vpsci_ros/RightTurn-v0", pedestrian="frozen")
