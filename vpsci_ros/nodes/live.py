"""Subscription to a running graph from outside, as for a page that shows it; a slow subscriber delays no node."""

from collections.abc import Callable

import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from vpsci_ros.nodes.domain import set_defaults
from vpsci_ros.nodes.topics import TOPICS


def subscribe_to_graph(name: str, take: Callable[[bytes], None], finished: Callable[[], bool]) -> None:
    """Call `take` with the newest serialized message of a graph in this ROS domain, until `finished()`.

    :param name: of `vpsci_ros.nodes.topics.TOPICS`, not latched.
    """
    set_defaults()
    context, topic = Context(), TOPICS[name]
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("live_view", context=context)
    newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_subscription(topic.type, topic.ros_name, take, newest, raw=True)
    executor = EventsExecutor(context=context)
    executor.add_node(node)
    try:
        while not finished():
            executor.spin_once(timeout_sec=0.1)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
