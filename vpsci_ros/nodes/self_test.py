"""Whether the middleware works here: a node in its own domain publishes a message and waits for it."""

import time

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from vpsci_msgs.msg import WorldState
from vpsci_ros.errors import VpsciError
from vpsci_ros.nodes.domain import own_domain, set_defaults

PATIENCE = 5.0  # [s] for a message to arrive


def exchange() -> float:
    """Return the time [s] until a node in its own domain received the message that it published.

    :raises VpsciError: nothing arrived in time.
    """
    set_defaults()
    context, came = Context(), list[WorldState]()
    with own_domain():
        rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
        try:
            node = rclpy.create_node("vpsci_doctor", context=context, enable_rosout=False)
            node.create_subscription(WorldState, "vpsci_doctor", came.append, 10)
            publisher, executor = (
                node.create_publisher(WorldState, "vpsci_doctor", 10),
                SingleThreadedExecutor(context=context),
            )
            executor.add_node(node)
            begun = time.monotonic()
            while not came and time.monotonic() < begun + PATIENCE:
                publisher.publish(WorldState())
                executor.spin_once(timeout_sec=0.1)
            taken = time.monotonic() - begun
        finally:
            context.try_shutdown()
    if not came:
        raise VpsciError(
            f"ROS 2: no message arrived within {PATIENCE:g} s; see whether a firewall or container blocks UDP on this "
            "host, and whether /dev/shm can be written"
        )
    return taken
