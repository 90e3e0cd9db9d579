"""A graph whose world is in a server: policies, monitor and recorder work on its car, and the bag holds it."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

carla = pytest.importorskip("carla", reason="pip install 'vpsci_ros[carla]'")
pytest.importorskip("scenariogeneration", reason="pip install 'vpsci_ros[formats]'")

from extras.carla.stand_in import StandInServer  # noqa: E402
from nodes.stage import Stage, overrides  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.experimental import EventsExecutor  # noqa: E402

from vpsci_ros.bags.episodes import read_bag_episodes  # noqa: E402
from vpsci_ros.bags.verify import verify_bag  # noqa: E402
from vpsci_ros.cli.parameter_file import load  # noqa: E402
from vpsci_ros.errors import InvalidInput  # noqa: E402
from vpsci_ros.exam.conduct import run_exam  # noqa: E402
from vpsci_ros.exam.exam import prepare  # noqa: E402
from vpsci_ros.exam.result import read_result  # noqa: E402
from vpsci_ros.extras.carla.node import CarlaWorld  # noqa: E402
from vpsci_ros.extras.carla.server import LiveServer  # noqa: E402
from vpsci_ros.extras.formats.opendrive import write_map  # noqa: E402
from vpsci_ros.nodes.agent_policy import PedestrianPolicy, VehiclePolicy  # noqa: E402
from vpsci_ros.nodes.recorder import Recorder  # noqa: E402
from vpsci_ros.nodes.safety_monitor import SafetyMonitor  # noqa: E402
from vpsci_ros.resources import params_dir  # noqa: E402
from vpsci_ros.world import load_scenario  # noqa: E402

BARE = {"pedestrians": ["learned"], "baseline": False, "allow_standing": True}
PEERS = ["world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "recorder"]


def test_policies_monitor_and_recorder_work_on_the_car_of_a_server_and_the_bag_holds_its_episodes(
    context: Context, closed: Callable[[Any], Any], weights: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_map(load_scenario(1), tmp_path / "road.xodr")
    stand_in = StandInServer((tmp_path / "road.xodr").read_text())
    server = LiveServer("", 0.05, connect=lambda host, port: stand_in)
    run = {"scenarios": [1], "episodes": 2, "batch": 1, "episode_time": 3.0, "spawn": "paper"}

    def given(**values: Any) -> dict[str, Any]:
        return {"context": context, "parameter_overrides": overrides(peers=PEERS, **values)}

    world = CarlaWorld(server=server, **given(**run))
    recorder = Recorder(**given(bag=str(tmp_path / "bag")))
    policies = VehiclePolicy(**given(weights=weights)), PedestrianPolicy(**given(weights=weights))
    monitor = SafetyMonitor(**given())
    monkeypatch.setattr("vpsci_ros.world.monitor.CRITICAL_TTC", 9.9)
    nodes = world, monitor, *policies, recorder
    session = closed(Stage(context, *nodes, executor=EventsExecutor))
    session.spin_until(lambda: world.finished)
    session.spin_until(lambda: recorder.quiet)
    recorder.close()
    assert world.counts.nonzero().keys() <= {"tick", "episodes_ended", "timeout", "collision", "goal"}, "no fault"
    episodes = list(read_bag_episodes(tmp_path / "bag"))
    assert [episode.name for episode in episodes] == ["1:0", "1:1"]
    driven = np.hypot(*np.diff([episodes[1].x, episodes[1].y])).sum()
    assert driven > 0.5
    with pytest.raises(InvalidInput, match="engine = carla, which cannot be simulated again here"):
        verify_bag(tmp_path / "bag")
    car = stand_in.actors[0].get_transform().location
    middle = np.hypot(car.x - episodes[1].x[-1], -car.y - episodes[1].y[-1])
    assert middle == pytest.approx(0.2, abs=1e-3), "the server's car, whose origin is 0.2 m behind"


@pytest.fixture
def client_of_a_stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have nodes find a client that connects to a stand-in of a server on the road of scenario 1."""
    write_map(load_scenario(1), tmp_path / "road.xodr")
    (tmp_path / "path").mkdir()
    (tmp_path / "path" / "carla.py").write_text(
        "import pathlib, sys\n"
        f"sys.path.remove({str(tmp_path / 'path')!r})\n"
        "del sys.modules['carla']\n"
        "import carla\n"
        "from extras.carla.stand_in import StandInServer\n"
        f"road = pathlib.Path({str(tmp_path / 'road.xodr')!r}).read_text()\n"
        "carla.Client = lambda host, port: StandInServer(road)\n"
    )
    tests = Path(__file__).parents[2]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path / "path"), str(tests)]), prepend=os.pathsep)


@pytest.mark.usefixtures("forked_nodes", "client_of_a_stand_in")
def test_an_exam_on_a_server_has_the_report_of_any_exam_and_says_which_engine_moved_the_car(
    domain: int, tmp_path: Path
) -> None:
    folder = tmp_path / "exam"
    world = {"scenarios": [1], "episodes": 2, "episode_time": 3.0, "engine": "carla", "action_timeout": 30.0}
    chosen = load(params_dir() / "ads_test.yaml").changed("world_simulator", world)
    exam = prepare(chosen.changed("ads_test", BARE))
    assert run_exam(exam, folder, ["collision_rate >= 0.9"], quiet=True) == []
    report = json.loads((folder / "report.json").read_text())
    assert report["exam"]["parameters"]["world_simulator"]["engine"] == "carla"
    assert report["drivers"]["ads"]["learned"]["episodes"] == 2
    alone = read_result(folder, "alone").episodes
    assert len(alone) == 2, "on the server, too"
    assert all(episode.path[-1] > 1.0 for episode in alone), "it drives there"
    with pytest.raises(InvalidInput, match="engine = carla"):
        verify_bag(folder / "runs" / "learned" / "1" / "bag")
