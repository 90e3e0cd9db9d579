"""The base class of a graph's nodes, with parameters from configuration classes, and the functions that run nodes."""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, TypeVar, get_origin

import rclpy
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from vpsci_ros.errors import InvalidInput, VpsciError, in_words, is_shortage
from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.nodes import status as reporting
from vpsci_ros.nodes.convert import diagnostics_message
from vpsci_ros.nodes.domain import require_security, set_defaults
from vpsci_ros.nodes.intake import Intake
from vpsci_ros.nodes.node_config import LEARNER, SECTIONS, section_classes
from vpsci_ros.nodes.output import Output
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.nodes.topics import SERVICES, TOPICS, listeners
from vpsci_ros.parameters import Parameter, pick, refuse_unknown, table
from vpsci_ros.runs.run_config import PeerConfig
from vpsci_ros.runs.stop_request import StopRequest, stop_requested_by_signals

T = TypeVar("T")
FLUSH_LIMIT = 4.0  # [s] for the recorder to receive a topic's last messages
DRAIN_QUIET = 0.3  # [s] without a message: nothing is on its way any more
DRAIN_LIMIT = 20.0  # [s] to receive what is still on its way when a node is to stop
DIAGNOSTICS_PERIOD = 1.0  # [s] of wall time
_SET_BY_ROS = ("use_sim_time", "start_type_description_service")


class _Destroying(type):
    """Metaclass that destroys a node whose constructor raises, rather than leave it to the garbage collector.

    A node that is collected with its publishers can hang in the middleware for ever (ros2/build_cop#248).
    """

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        node: Any = cls.__new__(cls, *args, **kwargs)  # type: ignore[arg-type]
        try:
            node.__init__(*args, **kwargs)
        except BaseException:
            if node.in_the_graph:
                node.destroy_node()
            raise
        return node


class GraphNode(Node, metaclass=_Destroying):
    """A node of the graph; `vpsci_ros.nodes.node_config.section_classes` says which parameters it has.

    :param context: a private context, or None for the global one.
    :param parameter_overrides: as in `rclpy.node.Node`, for graphs in one process.
    :raises InvalidInput: a parameter is unknown, of the wrong type or out of range.
    """

    essential_peers: tuple[str, ...] = ("world_simulator",)
    drains = False  # whether a node that is to stop first receives what is on its way to it
    in_the_graph = False  # from when there is something to destroy
    counts: WorldCounts | None = None  # of the world simulator, in its reports

    def __init__(
        self,
        name: str,
        *,
        context: Context | None = None,
        parameter_overrides: list[Any] | None = None,
    ) -> None:
        super().__init__(name, context=context, parameter_overrides=parameter_overrides or [])
        self.in_the_graph = True
        self._offered: list[Output] = []
        self._section = name
        self._values = self._declare()
        self.peers = self.config(PeerConfig).peers or list(self.essential_peers)
        self.finished = False
        self.stop = StopRequest()
        namespace = self.get_namespace().strip("/")
        self.frame_prefix = f"{namespace}/" if namespace else ""
        """Before the frames of this graph's vehicle and pedestrian, and its nodes' names in diagnostics."""
        self.simulated_at = 0
        """Simulated time [ns] of the latest message received or published, for the diagnostics; each node sets it."""
        self._wall_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.add_on_set_parameters_callback(self._check_parameters)  # both would be called at every declaration
        self.add_post_set_parameters_callback(self._take_up_parameters)
        self.intake = Intake(self)
        self.input = self.intake.add
        self.diagnostics = self.output("/diagnostics")
        self.wall_timer(DIAGNOSTICS_PERIOD, self.report)

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """The subscriptions that an executor serves: all but those that the node polls itself."""
        return (each for each in super().subscriptions if each not in self.intake.polled)

    def config(self, kind: type[T]) -> T:
        """Return an instance of `kind`, one of the node's configuration classes, with the node's parameters."""
        return pick(kind, self._values, self._section)

    def parameters_changed(self) -> None:
        """Apply the values that `config` returns; called after parameters were set on the running node."""

    def output(self, topic: str) -> Output:
        """Return a new `Output`, which publishes a topic of `TOPICS`."""
        made = Output(self, topic, listeners(topic, self.peers), self._is_stopping)
        self._offered.append(made)
        return made

    def _is_stopping(self) -> bool:
        return self.stop.is_set()

    def serve(self, name: str, callback: Callable[[Any, Any], Any]) -> None:
        """Offer a service of `SERVICES`, which `callback` answers."""
        self.create_service(SERVICES[name][0], name.removeprefix("/"), callback)

    def ready(self, topic: str, answer: str, by: str = "") -> None:
        """Log that the node is ready to answer messages on `topic` with messages on `answer`.

        :param by: what the answers depend on.
        """
        self.get_logger().info(
            f"ready: answers {self.full_name(topic)} on {self.full_name(answer)}" + f", {by}" * bool(by)
        )

    def full_name(self, topic: str) -> str:
        """Return the full name of a topic of `TOPICS`: with this node's namespace, unless graphs share the topic."""
        return self.resolve_topic_name(TOPICS[topic].ros_name)

    @property
    def simulated_time(self) -> Time:
        """The time `simulated_at` as the stamp of a message."""
        return Time(sec=self.simulated_at // 1_000_000_000, nanosec=self.simulated_at % 1_000_000_000)

    def wall_timer(self, period: float, callback: Callable[[], None]) -> Timer:
        """Create a timer of `period` [s] on the wall clock, independent of `use_sim_time`.

        Every timer of a node of the graph is one of these.
        """
        return self.create_timer(period, callback, clock=self._wall_clock)

    @property
    def state(self) -> str:
        """The node's state for its status, in a few words."""
        return "running"

    @property
    def awaited(self) -> list[str]:
        """The names of the nodes or topics that the node waits for."""
        return []

    def figures(self) -> dict[str, Any]:
        """Return rates, progress and versions to be shown, by name; called about once a second."""
        return {}

    def status(self) -> NodeStatus:
        """Return the node's report: state, awaited nodes, figures, and numbers of published and refused messages."""
        return NodeStatus(
            state=self.state,
            awaited=self.awaited,
            figures=self.figures(),
            published={output.topic: output.published for output in self._offered if output.published},
            refused=dict(self.intake.refused),
            second_publishers=self.intake.second_publishers,
            counts=self.counts,
        )

    def report(self, *, wait: bool = False) -> None:
        """Publish the status on `/diagnostics` and `submit` it; called once a second of wall time, and at the end.

        :param wait: for the expected readers; otherwise the message is dropped where one is missing.
        :raises VpsciError: waited for longer than `PEER_TIMEOUT`.
        """
        self.intake.look()
        status = self.status()
        if wait or self.diagnostics.matched:
            name = f"{self.frame_prefix}{self.get_name()}"
            message = diagnostics_message(name, status, self.simulated_time, self._values)
            (self.diagnostics.publish if wait else self.diagnostics.publish_now)(message)
        self.submit(status)

    def submit(self, status: NodeStatus) -> None:
        """Send a status through a pipe to the process that runs the graph, if one has started this process."""
        reporting.send(self._section, status)

    @property
    def quiet(self) -> bool:
        """Whether the node may stop now; a node that `drains` first receives the messages still on their way."""
        return not self.drains or time.perf_counter() - self.intake.arrived > DRAIN_QUIET

    def close(self) -> None:
        """Complete the node's work; called once however its run ends, while publishing still works."""

    def flush(self) -> None:
        """Wait until the recorder has this node's messages, at most `FLUSH_LIMIT` a topic."""
        for output in self._offered:
            if "recorder" in output.expected and output.published:
                output.flush(FLUSH_LIMIT)

    def _check_parameters(self, given: list[RosParameter]) -> SetParametersResult:
        try:
            values = self._values | self._own(given)
            for kind in section_classes(self._section, values):
                pick(kind, values, f"node {self._section}")
        except InvalidInput as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_up_parameters(self, given: list[RosParameter]) -> None:
        if own := self._own(given):
            self._values |= own
            self.parameters_changed()

    def _own(self, given: list[RosParameter]) -> dict[str, Any]:
        values = {each.name: each.value for each in given if each.name in self._values}
        return {name: list(value) if _is_sequence(value) else value for name, value in values.items()}

    def _declare(self) -> dict[str, Any]:
        overrides = {name: parameter.value for name, parameter in self._parameter_overrides.items()}
        rows = {row.name: row for kind in section_classes(self._section, overrides) for row in table(kind)}
        learner = LEARNER if self._section != "learner" else {}
        others = [kinds for section, kinds in (SECTIONS | learner).items() if section != self._section]
        elsewhere = {row.name for kinds in others for kind in kinds for row in table(kind)}
        own = {k: v for k, v in overrides.items() if not k.startswith("qos_overrides") and k not in _SET_BY_ROS}
        # A file's /** section reaches every node, so a name that another node declares is not an error here.
        refuse_unknown({k: v for k, v in own.items() if k not in elsewhere}, rows, f"node {self._section}")
        chosen = {}
        for name, row in rows.items():
            given = own.get(name, row.default)
            if given is None and get_origin(row.type) is list:
                given = []  # rcl reads an empty list of a parameter file as no value
            chosen[name] = row.check(list(given) if _is_sequence(given) else given, f"node {self._section}")
            self.declare_parameter(name, chosen[name], _descriptor(row), ignore_override=True)
        return chosen


def run_together(kinds: Sequence[Any], args: list[str] | None = None) -> int:
    """Run a node of each class until the first class's node has finished or a signal comes; return the exit status.

    0: finished or stopped on request; 1: one failed; 2: a parameter or an input file was refused.

    Discovery stays on this host unless the environment says otherwise. Signals only set a flag, so that on the way out
    the context is alive and a node can still write and publish.
    """
    set_defaults()
    try:
        require_security()
    except VpsciError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    context = Context()
    with stop_requested_by_signals(to_the_end=True) as stop:
        rclpy.init(args=args, context=context, signal_handler_options=SignalHandlerOptions.NO)
        try:
            return _run(kinds, context, stop)
        finally:
            context.try_shutdown()


def _run(kinds: Sequence[Any], context: Context, stop: StopRequest) -> int:
    nodes: list[GraphNode] = []
    try:
        for kind in kinds:
            nodes.append(kind(context=context))
            nodes[-1].stop = stop
    except (VpsciError, OSError, MemoryError) as error:
        print(f"error: {error if isinstance(error, VpsciError) else in_words(error)}", file=sys.stderr)
        for node in nodes:
            node.destroy_node()
        return 2 if isinstance(error, VpsciError) and not is_shortage(error) else 1
    executor = EventsExecutor(context=context)
    for node in nodes:
        executor.add_node(node)
    try:
        return run_nodes(nodes, executor)
    finally:
        executor.shutdown()
        for node in nodes:
            node.destroy_node()


def run_nodes(nodes: Sequence[GraphNode], executor: EventsExecutor) -> int:
    """Run nodes until `nodes[0]` has finished or a stop is requested, and close all; return 0, or 1 after an error."""
    status = 1
    try:
        status = _attempt(nodes[0], partial(_spin, nodes[0], executor))
    finally:
        for node in nodes:
            if not node.drains:
                status = max(status, _attempt(node, partial(_end, node)))
        deadline = time.monotonic() + DRAIN_LIMIT
        while not all(node.quiet for node in nodes) and time.monotonic() < deadline:
            _spin_once(executor)
        for node in nodes:
            if node.drains:
                status = max(status, _attempt(node, partial(_end, node)))
        for node in nodes:
            node.flush()
            node.submit(node.status())
    return status


def _spin(first: GraphNode, executor: EventsExecutor) -> None:
    while not first.stop.is_set() and not first.finished:
        _spin_once(executor)


def _spin_once(executor: EventsExecutor) -> None:
    executor.spin_once(timeout_sec=0.1)  # in these wheels EventsExecutor.spin() runs no callback


def _end(node: GraphNode) -> None:
    node.report()
    node.close()


def _attempt(node: GraphNode, part: Callable[[], None]) -> int:
    """Call `part`, a part of a node's run; return 0, or 1 after an error, which is logged."""
    try:
        part()
    except VpsciError as error:
        node.get_logger().error(str(error))
        return 1
    except (OSError, MemoryError) as error:
        node.get_logger().error(in_words(error))
        return 1
    return 0


def _descriptor(row: Parameter) -> ParameterDescriptor:
    text = f"{row.description} [{row.unit}]" if row.unit else row.description
    constraints = f"one of {', '.join(row.choices)}" if row.choices else ""
    descriptor = ParameterDescriptor(
        description=text,
        additional_constraints=constraints,
        read_only=row.read_only,
        dynamic_typing=row.type not in (bool, int, float, str),  # an empty list does not show its type
    )
    if row.low is not None and row.high is not None:
        if row.type is float:
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(row.low), to_value=float(row.high))]
        elif row.type is int:
            descriptor.integer_range = [IntegerRange(from_value=int(row.low), to_value=int(row.high))]
    return descriptor


def _is_sequence(value: Any) -> bool:
    return not isinstance(value, str) and hasattr(value, "__len__")
