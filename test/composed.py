"""A whole graph in this process, as `graph.composed` has it in one of its own, for tests."""

from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from vpsci_ros.nodes.base import GraphNode, run_nodes
from vpsci_ros.nodes.domain import set_defaults
from vpsci_ros.nodes.entry import node_class
from vpsci_ros.nodes.node_config import GraphConfig
from vpsci_ros.runs.run_config import Sections


@contextmanager
def composed(sections: Sections) -> Iterator[dict[str, GraphNode]]:
    """Make the nodes of a graph, run it to its leader's end, close them, yield them by name, and tidy up.

    :param sections: resolved, see `vpsci_ros.nodes.graph.resolve`.
    :raises InvalidInput: a parameter is refused.
    """
    set_defaults()
    names = sections.get(GraphConfig, "graph").nodes
    leader = "world_simulator" if "world_simulator" in names else "learner"
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    spinner = EventsExecutor(context=context)
    nodes: dict[str, GraphNode] = {}
    try:
        for name in sorted(names, key=lambda name: name != leader):
            values = {**sections.values[name], "peers": list(names)}
            overrides = [Parameter(key, value=value) for key, value in values.items() if value != []]
            nodes[name] = node_class(name)(context=context, parameter_overrides=overrides)
            spinner.add_node(nodes[name])
        assert run_nodes([*nodes.values()], spinner) == 0, "a node has failed, and its log says why"
        yield nodes
    finally:
        spinner.shutdown()
        for node in nodes.values():
            node.destroy_node()
        context.try_shutdown()
