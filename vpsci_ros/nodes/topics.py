"""The graph as a table: each topic with type, publishers, subscribers and quality of service."""

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String, UInt64
from std_srvs.srv import SetBool, Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from vpsci_msgs.msg import AgentAction, EpisodeEvent, PolicyWeights, SafetyState, Transition, VehicleControl, WorldState
from vpsci_ros.nodes.node_config import NODES

LOCK_STEP = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""For messages that a decision depends on: none is lost, and a subscriber may be a thousand messages behind."""

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For state that late subscribers need: the publisher stores the last message for them."""

COMMANDS = QoSProfile(depth=32, reliability=ReliabilityPolicy.RELIABLE)
"""For commands of a driving system, of which the newest counts: too many must not delay the world's other messages."""

RECORDING = QoSProfile(depth=1000, history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
"""For a subscriber that must receive every message, such as the recorder and the learner."""


@dataclass(frozen=True)
class Topic:
    """A topic of the graph: its type, the graph's nodes that publish it and that subscribe to it, and its QoS.

    :ivar shared: stays at the root where a graph has a namespace, since other tools look for it there.
    """

    name: str
    type: Any
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]
    qos: QoSProfile
    shared: bool = False

    @property
    def ros_name(self) -> str:
        """The name to give to rclpy, relative to the node's namespace unless graphs share the topic."""
        return self.name if self.shared else self.name.removeprefix("/")

    def quality(self, qos: QoSProfile | None = None) -> dict[str, Any]:
        """Return the topic's quality of service, or `qos`, as arguments of rclpy.

        With them rclpy declares `qos_overrides.TOPIC.(publisher|subscription).(history|depth|reliability)` as
        parameters, and writes what they say into the profile, which therefore is a copy.
        """
        overriding = QoSOverridingOptions.with_default_policies()
        return {"qos_profile": copy(qos or self.qos), "qos_overriding_options": overriding}

    @cached_property
    def type_name(self) -> str:
        """The type as bags name it, such as "nav_msgs/msg/Odometry"."""
        return f"{self.type.__module__.partition('.')[0]}/msg/{self.type.__name__}"


_POLICIES = ("vehicle_policy", "pedestrian_policy")

TOPICS = {
    topic.name: topic
    for topic in (
        Topic("/clock", Clock, ("world_simulator",), ("recorder",), LOCK_STEP),
        Topic(
            "/world/state",
            WorldState,
            ("world_simulator",),
            ("safety_monitor", *_POLICIES, "perception", "recorder"),
            LOCK_STEP,
        ),
        Topic(
            "/safety/state", SafetyState, ("safety_monitor",), ("world_simulator", *_POLICIES, "recorder"), LOCK_STEP
        ),
        Topic("/vehicle/action", AgentAction, ("vehicle_policy",), ("world_simulator", "recorder"), LOCK_STEP),
        Topic("/pedestrian/action", AgentAction, ("pedestrian_policy",), ("world_simulator", "recorder"), LOCK_STEP),
        Topic("/vehicle/cmd_accel", AccelStamped, (), ("world_simulator", "recorder"), LOCK_STEP),
        Topic("/vehicle/cmd_control", VehicleControl, (), ("world_simulator", "recorder"), LOCK_STEP),
        Topic("/vehicle/odometry", Odometry, ("world_simulator",), ("recorder",), LOCK_STEP),
        Topic("/pedestrian/odometry", Odometry, ("world_simulator",), ("recorder",), LOCK_STEP),
        Topic("/pedestrians/odometry", Odometry, ("world_simulator",), ("recorder",), LOCK_STEP),
        Topic("/perception/objects", PointCloud2, ("perception",), ("recorder",), LOCK_STEP),
        Topic("/episode/event", EpisodeEvent, ("world_simulator",), ("recorder",), LOCK_STEP),
        Topic("/replay", Transition, ("world_simulator",), ("learner", "recorder"), LOCK_STEP),
        Topic("/replay/consumed", UInt64, ("learner",), ("world_simulator",), LATCHED),
        Topic("/policy/weights", PolicyWeights, ("learner",), _POLICIES, LATCHED),
        Topic("/markers", MarkerArray, ("world_simulator",), ("recorder",), LOCK_STEP),
        Topic("/vehicle/robot_description", String, ("world_simulator",), (), LATCHED),
        Topic("/pedestrian/robot_description", String, ("world_simulator",), (), LATCHED),
        Topic("/tf", TFMessage, ("world_simulator",), ("recorder",), LOCK_STEP, shared=True),
        Topic("/tf_static", TFMessage, ("world_simulator",), ("recorder",), LATCHED, shared=True),
        Topic("/diagnostics", DiagnosticArray, NODES, ("perception", "recorder"), LOCK_STEP, shared=True),
    )
}


SERVICES: dict[str, tuple[Any, str]] = {
    "/world/pause": (SetBool, "data true: pauses at the present tick; false: resumes"),
    "/world/step": (Trigger, "while paused, goes on to the next tick as soon as the present tick has its answers"),
}
"""The services of the graph: the type and what it does, by name."""


def listeners(topic: str, peers: list[str]) -> list[str]:
    """Return the nodes among `peers` that subscribe to `topic`."""
    return [name for name in TOPICS[topic].subscribers if name in peers]


def speakers(topic: str, peers: list[str]) -> list[str]:
    """Return the nodes among `peers` that publish `topic`."""
    return [name for name in TOPICS[topic].publishers if name in peers]
