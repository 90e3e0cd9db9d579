"""Subscription to a running graph from outside, as for a page that shows it; a slow subscriber delays no node."""

from collections.abc import Callable, Iterable
from functools import partial

import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from vpsci_ros.nodes.domain import set_defaults
from vpsci_ros.nodes.topics import LATCHED, TOPICS

SHOWN = tuple(name for name in TOPICS if name not in ("/replay", "/replay/consumed", "/policy/weights"))
"""Topics that a viewer reads; the others are the learner's, and long."""


def subscribe_to_graph(
    names: Iterable[str], take: Callable[[str, bytes], None], finished: Callable[[], bool], namespace: str = "", *,
    depth: int = 1,
) -> None:  # fmt: skip
    """Call `take(topic, serialized message)` for the messages of a graph in this ROS domain, until `finished()`.

    :param names: of `vpsci_ros.nodes.topics.TOPICS`.
    :param namespace: of the graph.
    :param depth: messages of a topic that wait to be taken; of those that come faster, the older ones are lost.
    """
    set_defaults()
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("live_view", context=context, namespace=namespace)
    newest = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
    for row in (TOPICS[name] for name in names):
        quality = LATCHED if row.qos is LATCHED else newest
        node.create_subscription(row.type, row.ros_name, partial(take, row.name), quality, raw=True)
    executor = EventsExecutor(context=context)
    executor.add_node(node)
    try:
        while not finished():
            executor.spin_once(timeout_sec=0.1)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
