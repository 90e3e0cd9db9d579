"""Nodes of one process under one executor, spun until something holds."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header

from vpsci_msgs.msg import AgentAction, SafetyState
from vpsci_ros.nodes import convert
from vpsci_ros.nodes.topics import LOCK_STEP
from vpsci_ros.wire import layout
from vpsci_ros.wire.answers import SafetyContent, write_safety_state
from vpsci_ros.wire.header import WireHeader, tick_header
from vpsci_ros.wire.odometry import write_odometry
from vpsci_ros.wire.world_state import StateContent, write_world_state
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import Tick

PATIENCE = 240.0  # [s]


def overrides(**values: Any) -> list[Parameter]:
    """Return the parameters of a node of which the caller sets some."""
    return [Parameter(name.replace("__", "."), value=value) for name, value in values.items()]


def action_message(header: Header, tick: int, action: NDArray[np.floating[Any]], policy_version: int) -> AgentAction:
    """Return accelerations [m/s2], [B, 2] as (longitudinal, lateral), as a message."""
    message = AgentAction(header=header, tick=tick, policy_version=policy_version)
    longitudinal, lateral = np.asarray(action, float).T
    return convert.filled(message, {"longitudinal": longitudinal, "lateral": lateral})


def state_bytes(state: NDArray[np.void], policy_frame: Any, tick: int, period: float = 0.05) -> bytes:
    """Return `/world/state` of EPISODE[B] records, serialized."""
    header = tick_header(tick, period)
    return write_world_state(StateContent(header, Tick(tick, state, np.asarray(policy_frame, np.bool_)), period))


def safety_bytes(tick: int, curvttc: Any, distance: Any, critical: Any) -> bytes:
    """Return `/safety/state` of a tick of 0.05 s, serialized."""
    header = tick_header(tick, 0.05)
    values = np.asarray(curvttc, float), np.asarray(distance, float), np.asarray(critical, np.uint8)
    return write_safety_state(SafetyContent(header, tick, *values))


def odometry_messages(record: np.void, header: Header, prefix: str = "") -> list[Odometry]:
    """Return vehicle and pedestrian of one EPISODE record as odometry; `prefix` comes before their frames' names."""
    at = WireHeader(header.stamp.sec, header.stamp.nanosec, header.frame_id)
    written = (write_odometry(layout.motion_of(record, agent), f"{prefix}{agent}", at) for agent in AGENTS)
    return [deserialize_message(data, Odometry) for data in written]


class Stage:
    """Nodes under one executor, and a node `peer` that listens and speaks."""

    def __init__(
        self, context: Context, *nodes: Any, peer: str = "peer", executor: type[Executor] = SingleThreadedExecutor
    ) -> None:
        self.context = context
        self.executor = executor(context=context)
        self._nodes: list[Node] = []
        for node in nodes:
            self.add(node)
        self.peer: Node = self.add(rclpy.create_node(peer, context=context))

    def add(self, node: Any) -> Any:
        """Have a node spun and, in the end, destroyed."""
        self._nodes.append(node)
        self.executor.add_node(node)
        return node

    def spin_until(self, condition: Callable[[], bool]) -> None:
        """Spin until a condition holds that messages bring about."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, f"waited {PATIENCE:g} s in vain"
            self.executor.spin_once(timeout_sec=0.02)

    def offered(self, policy: Any) -> None:
        """Have the peer publish what a policy waits for from the monitor, and spin until the policy may answer."""
        self.peer.create_publisher(SafetyState, "safety/state", LOCK_STEP)
        self.spin_until(lambda: policy.state == "running")

    def call(self, kind: Any, name: str, **request: Any) -> Any:
        """Return what a service replies."""
        client = self.peer.create_client(kind, name)
        self.spin_until(client.service_is_ready)
        future = client.call_async(kind.Request(**request))
        self.spin_until(future.done)
        return future.result()

    def close(self) -> None:
        """End the executor and all nodes."""
        self.executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
