"""A public motion planner stops for who stands in its lane, and drives through the graph."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from composed import composed

pytest.importorskip("fiss_planner", reason="needs fiss-planner (extra: planner)")

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.exam.exam import prepare
from vpsci_ros.exam.process import running
from vpsci_ros.exam.run import autopilot_run
from vpsci_ros.nodes.convert import objects_message
from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.nodes.graph import resolve
from vpsci_ros.resources import params_dir
from vpsci_ros.wire.layout import PlanarMotion, motion_of
from vpsci_ros.world import EPISODE, RUNNING, load_scenario
from vpsci_ros.world.kinematics import drive
from vpsci_ros.world.perception import OBJECT

PROGRAM = Path(__file__).parents[2] / "examples" / "motion_planner.py"
PERIOD = 0.05  # [s]
TOUCH = 2.345 + 0.3  # [m] from the vehicle's centre to a pedestrian's whom its bumper touches


@pytest.fixture(scope="module")
def example(tool: Callable[..., ModuleType]) -> ModuleType:
    return tool("motion_planner", "examples")


def driven(example: ModuleType, number: int, episode: int, people: list[tuple[float, float]]) -> np.ndarray:
    """Return x, y and speed [m, m/s] over 12 s, float64[240, 3], of a car at 4 m/s among people who stand."""
    path = load_scenario(number).vehicle.path.points
    state = np.zeros(1, EPISODE)[0]
    state["status"], state["scenario"], state["episode"] = RUNNING, number, episode
    along = path[1] - path[0]
    state["vehicle_x"], state["vehicle_y"], state["vehicle_speed"] = *path[0], 4.0
    state["vehicle_heading"] = np.arctan2(along[1], along[0])
    driver, standing, rows = example.Driver(), [example.Person(*place, 0.0, 0.0) for place in people], []
    by_class = example.PlannerDriver()
    by_class.reset(SimpleNamespace(scenario=load_scenario(number)))
    pedestrians = [PlanarMotion(*place, 0.0, 0.0, 0.0) for place in people]
    names = [f"vehicle_{name}" for name in ("x", "y", "heading", "speed")]
    for frame in range(240):
        state["frame"] = frame
        seen = SimpleNamespace(vehicle=motion_of(state, "vehicle"), pedestrians=pedestrians)
        controls = driver.control(state, standing, PERIOD)
        assert by_class.act(seen) == pytest.approx(controls, abs=1e-9), "the class drives as the node does"
        before = float(state["vehicle_speed"])
        values = drive(*(float(state[name]) for name in names), *controls, PERIOD)
        for name, value in zip(names, values, strict=False):
            state[name] = value
        state["vehicle_acceleration"] = (values[3] - before) / PERIOD
        rows.append((values[0], values[1], values[3]))
    return np.array(rows)


@pytest.mark.parametrize("number", [1, 101])
def test_it_stops_before_somebody_who_stands_in_the_lane_through_which_it_drives_otherwise(
    example: ModuleType, number: int
) -> None:
    lane = load_scenario(number).vehicle.path.points
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(lane, axis=0).T))])
    place = np.array([np.interp(22.0, way, lane[:, 0]), np.interp(22.0, way, lane[:, 1])])
    free, stopped = driven(example, number, 0, []), driven(example, number, 0, [tuple(place)])
    assert np.hypot(*(free[:, :2] - place).T).min() < 0.5, "it keeps to the middle of a free lane"
    assert free[-1, 2] == pytest.approx(4.0, abs=0.2)
    assert np.hypot(*(stopped[:, :2] - place).T).min() > TOUCH + 0.5
    assert stopped[-1, 2] < 0.5


def test_one_driver_plans_each_episode_by_itself(example: ModuleType) -> None:
    driver = example.Driver()
    states = np.zeros(3, EPISODE)
    states["status"], states["episode"], states["scenario"] = RUNNING, [0, 1, 2], [1, 101, 1]
    for state in states:
        path = load_scenario(int(state["scenario"])).vehicle.path.points
        state["vehicle_x"], state["vehicle_y"], state["vehicle_speed"] = *path[0], 3.0
        state["vehicle_heading"] = np.arctan2(*(path[1] - path[0])[::-1])
        steer, throttle, brake = driver.control(state, [], PERIOD)
        assert abs(steer) < 0.1
        assert throttle > 0.0
        assert brake == 0.0


def test_it_reads_the_list_of_objects_that_perception_publishes(example: ModuleType) -> None:
    objects = np.zeros(2, OBJECT)
    objects["x"], objects["y"], objects["vx"], objects["vy"] = [1.5, -2.0], [3.0, 4.0], [0.5, 0.0], [-1.0, 0.25]
    seen = example.people_seen(objects_message(objects, Time(nanosec=350_000_000)))
    assert seen == [(1.5, 3.0, 0.5, -1.0), (-2.0, 4.0, 0.0, 0.25)]
    assert example.people_seen(objects_message(objects[:0], Time())) == []


def test_through_the_graph_it_answers_every_tick_and_stops_for_whom_the_autopilot_hits(tmp_path: Path) -> None:
    world = {"scenarios": [1], "episodes": 2, "episode_time": 8.0, "action_timeout": 30.0, "pedestrians": 3}
    world["spawn"] = "human"
    graph = {"batch": 1, "vehicle_driver": "external", "pedestrian_driver": "autopilot"}
    exam = load(params_dir() / "ads_test.yaml").changed("world_simulator", world)
    hit = [each.outcome for each in autopilot_run(prepare(exam, "external"), "walker").episodes]
    assert hit == ["collision", "collision"]
    chosen = exam.changed("world_simulator", graph).changed("perception", {"latency": 0.1})
    chosen = chosen.changed("graph", {"nodes": ["world_simulator", "safety_monitor", "perception"]})
    command = [sys.executable, str(PROGRAM), "--objects", "0.1"]
    with own_domain(), running(command, tmp_path / "log"), composed(resolve(chosen, tmp_path)) as made:
        counts = made["world_simulator"].counts
    assert counts is not None
    assert (counts.timeout, counts.collision) == (2, 0), counts
    assert (counts.vehicle_answers_missing, counts.vehicle_commands_refused) == (0, 0)
    assert counts.vehicle_commands == 2 * 160, "one for each tick of 0.05 s, the last of an episode left out"
