"""The form that nodes share: parameters are checked before anything runs, and no message is lost at the start."""

import threading

import pytest
import rclpy
from rclpy.context import Context
from rclpy.parameter import Parameter

from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.safety_monitor import SafetyMonitor


def override(name: str, value: object) -> Parameter:
    return Parameter(name, value=value)


def test_parameters_carry_description_unit_and_range(context: Context) -> None:
    node = SafetyMonitor(context=context)
    descriptor = node.describe_parameter("horizon")
    assert descriptor.description == "look ahead so far [s]"
    assert (descriptor.floating_point_range[0].from_value, descriptor.floating_point_range[0].to_value) == (0.1, 60.0)
    assert descriptor.read_only
    assert node.get_parameter("horizon").value == 10.0
    node.destroy_node()


def test_a_whole_number_sets_a_floating_point_parameter(context: Context) -> None:
    node = SafetyMonitor(context=context, parameter_overrides=[override("horizon", 8)])
    assert node.get_parameter("horizon").value == 8.0
    node.destroy_node()


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("horizn", 8.0, "unknown parameter 'horizn'; did you mean horizon"),
        ("horizon", -1.0, "horizon = -1.0 is out of range; expected 0.1 to 60 s"),
        ("horizon", "far", "horizon must be a number, got 'far'"),
        ("method", "circle", "expected one of footprint, center"),
    ],
)
def test_a_bad_parameter_is_refused(context: Context, name: str, value: object, message: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        SafetyMonitor(context=context, parameter_overrides=[override(name, value)])
    assert "safety_monitor" in str(caught.value)
    assert message in str(caught.value)


def test_a_parameter_of_another_node_is_let_pass_because_a_file_may_address_all(context: Context) -> None:
    node = SafetyMonitor(context=context, parameter_overrides=[override("batch", 4)])
    assert not node.has_parameter("batch")
    node.destroy_node()


def test_the_first_message_waits_for_the_expected_readers(context: Context) -> None:
    node = GraphNode("safety_monitor", context=context, parameter_overrides=[override("peers", ["world_simulator"])])
    output = node.output("/safety/state")
    assert output.expected == ["world_simulator"]
    assert not output.matched
    received = threading.Event()
    reader = rclpy.create_node("reader", context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(reader)

    def publish() -> None:
        output.publish(output._publisher.msg_type())

    publisher = threading.Thread(target=publish)
    publisher.start()
    reader.create_subscription(output._publisher.msg_type, "safety/state", lambda _: received.set(), 10)
    while not received.is_set() and rclpy.ok(context=context):
        executor.spin_once(timeout_sec=0.1)
    publisher.join(10.0)
    assert received.is_set()
    assert not publisher.is_alive()
    executor.shutdown()
    reader.destroy_node()
    node.destroy_node()


def test_a_reader_that_never_comes_is_named(context: Context) -> None:
    overrides = [override("peers", ["world_simulator", "recorder"]), override("peer_timeout", 0.2)]
    node = GraphNode("safety_monitor", context=context, parameter_overrides=overrides)
    output = node.output("/safety/state")
    with pytest.raises(VpsciError, match="waited 0.2 s for world_simulator and recorder to subscribe to /safety/state"):
        output.publish(output._publisher.msg_type())
    node.destroy_node()
