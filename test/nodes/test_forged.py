"""What decides that a run is complete comes from its own nodes: a stranger who forges their reports changes nothing."""

import math
import threading
import time
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from nodes.stage import action_message
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from vpsci_msgs.msg import AgentAction, WorldState
from vpsci_ros.nodes import convert
from vpsci_ros.nodes.graph import run_graph
from vpsci_ros.nodes.topics import LOCK_STEP
from vpsci_ros.runs.sections import Sections

HARMLESS = ("vehicle_answers_contradicted", "vehicle_answers_early", "vehicle_answers_missing")


class Forger:
    """Answers every state in the place of the vehicle's policy, and reports in the world's name that nobody did."""

    def __init__(self, context: Context) -> None:
        self._node = rclpy.create_node("forger", context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._actions = self._node.create_publisher(AgentAction, "vehicle/action", LOCK_STEP)
        self._reports = self._node.create_publisher(DiagnosticArray, "/diagnostics", LOCK_STEP)
        self._node.create_subscription(WorldState, "world/state", self._on_state, LOCK_STEP)
        self._ends = threading.Event()
        self._heard = math.inf  # when it heard of the world
        self._thread = threading.Thread(target=self._spin)
        self.reports = 0

    def __enter__(self) -> "Forger":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()

    def _spin(self) -> None:
        while not self._ends.is_set() and time.monotonic() < self._heard + 2.0:  # or the recorder would drain on
            self._executor.spin_once(timeout_sec=0.05)
            values = [KeyValue(key=key, value="0") for key in HARMLESS]
            status = DiagnosticStatus(name="world_simulator", message="running", values=values)
            self._reports.publish(DiagnosticArray(header=self._header(), status=[status]))
            self.reports += 1

    def _on_state(self, message: WorldState) -> None:
        self._heard = time.monotonic()
        action = np.full((len(message.status), 2), -3.0)
        self._actions.publish(action_message(message.header, message.tick, action, 1))

    @staticmethod
    def _header() -> convert.Header:
        return convert.Header(stamp=convert.stamp(1, 0.05))


def test_a_stranger_who_drives_the_car_and_forges_the_worlds_diagnostics_is_named_and_the_run_fails(
    context: Context, tmp_path: Path
) -> None:
    policy = {"weights": "pretrained"}
    chosen = {
        "graph": {
            "nodes": ["world_simulator", "safety_monitor", "vehicle_policy", "recorder"],
            "progress_timeout": 240.0,  # kernels that are compiled first
        },
        "world_simulator": {"scenarios": [1], "episodes": 2, "batch": 2, "pedestrian_driver": "autopilot"}
        | {"action_timeout": 30.0, "real_time_factor": 3.0, "episode_time": 9.0},  # so that it is heard, 3 s
        "vehicle_policy": policy,
    }
    with Forger(context) as forger:
        result = run_graph(Sections(chosen), tmp_path / "run", quiet=True)
    assert forger.reports > 10
    assert "a second publisher: /forger on /vehicle/action" in result.error
    assert "answers contradict those of vehicle_policy: another program answered, too" in result.error
    assert "are not the graph's: another program published, too (/forger on /diagnostics" in result.error
