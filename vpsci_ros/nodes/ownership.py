"""Whose message it is on a topic that all graphs in a ROS domain share, and other programs besides."""

from diagnostic_msgs.msg import DiagnosticArray
from tf2_msgs.msg import TFMessage

from vpsci_ros.nodes.config import EXECUTABLES
from vpsci_ros.world.observation import AGENTS


def is_own(message: DiagnosticArray | TFMessage, prefix: str) -> bool:
    """Return whether a message is of the graph whose names begin with `prefix`, such as "left/", or nothing."""
    if isinstance(message, DiagnosticArray):
        own = {f"{prefix}{name}" for name in EXECUTABLES}
        return bool(message.status) and all(status.name in own for status in message.status)
    frames = [transform.child_frame_id for transform in message.transforms]
    return bool(frames) and all(frame.startswith(tuple(f"{prefix}{agent}" for agent in AGENTS)) for frame in frames)
