"""The form that nodes share: parameters are checked before anything runs, and no message is lost at the start."""

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
import yaml
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy

from vpsci_msgs.msg import SafetyState
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.training_config import LearnerConfig, PretrainConfig, RefineConfig
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.node_config import SECTIONS
from vpsci_ros.nodes.perception import Perception
from vpsci_ros.nodes.safety_monitor import SafetyMonitor
from vpsci_ros.nodes.topics import LOCK_STEP, TOPICS
from vpsci_ros.parameters import read_parameter_file
from vpsci_ros.policy.policy_config import NoiseConfig, PolicyConfig
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.run_config import RunConfig


def override(name: str, value: object) -> Parameter:
    return Parameter(name, value=value)


def test_parameters_carry_description_unit_and_range(context: Context) -> None:
    node = Perception(context=context)
    descriptor = node.describe_parameter("field_of_view")
    assert descriptor.description == "total angle of view, centred straight ahead [degrees]"
    (within,) = descriptor.floating_point_range
    assert (within.from_value, within.to_value) == (1.0, 360.0)
    assert descriptor.read_only
    assert node.get_parameter("field_of_view").value == 360.0
    node.destroy_node()


def test_a_node_whose_making_fails_is_destroyed_at_once_and_not_by_the_garbage_collector(context: Context) -> None:
    class Failing(SafetyMonitor):
        def __init__(self) -> None:
            super().__init__(context=context)
            raise InvalidInput("no such file")

    onlooker = rclpy.create_node("onlooker", context=context)
    with pytest.raises(InvalidInput) as caught:  # whose traceback keeps the node alive
        Failing()
    assert caught.traceback
    assert onlooker.get_node_names() == ["onlooker"]
    onlooker.destroy_node()


def test_a_learner_has_the_parameters_of_its_stage_and_refuses_those_of_the_other(context: Context) -> None:
    learner = GraphNode("learner", context=context, parameter_overrides=[override("held_out_clips", ["none"])])
    assert learner.config(PretrainConfig).held_out_clips == ["none"]
    assert not learner.has_parameter("updates_per_episode")
    learner.destroy_node()
    refine = [override("stage", "refine"), override("updates_per_episode", 0.5)]
    learner = GraphNode("learner", context=context, parameter_overrides=refine)
    assert learner.config(RefineConfig).updates_per_episode == 0.5
    learner.destroy_node()
    with pytest.raises(InvalidInput, match=r"node learner: unknown parameter 'held_out_clips'"):
        GraphNode("learner", context=context, parameter_overrides=[*refine, override("held_out_clips", ["none"])])


def test_nodes_started_one_by_one_take_seed_and_noise_from_the_section_for_every_node(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    shared = {"seed": 7, "noise": {"start": 0.25}}
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": shared}, "learner": {"ros__parameters": {"seed": 8}}}))
    context = Context()
    rclpy.init(args=["--ros-args", "--params-file", str(path)], context=context)
    try:
        nodes = {name: GraphNode(name, context=context) for name in ("vehicle_policy", "world_simulator", "learner")}
        assert nodes["vehicle_policy"].config(PolicyConfig).noise == NoiseConfig(start=0.25)
        assert nodes["vehicle_policy"].config(PolicyConfig).seed == 7
        assert nodes["world_simulator"].config(RunConfig).seed == 7
        assert nodes["learner"].config(LearnerConfig).seed == 8, "its own section wins"
        for node in nodes.values():
            node.destroy_node()
    finally:
        context.try_shutdown()


def test_the_first_message_waits_for_the_expected_readers_and_not_for_others_in_their_place(context: Context) -> None:
    node = GraphNode("safety_monitor", context=context, parameter_overrides=[override("peers", ["world_simulator"])])
    output = node.output("/safety/state")
    kind = TOPICS["/safety/state"].type
    assert output.expected == ["world_simulator"]
    received = threading.Event()
    driving_system, reader = (rclpy.create_node(name, context=context) for name in ("ads", "world_simulator"))
    driving_system.create_subscription(kind, "safety/state", print, 10)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(reader)
    while not node.get_subscriptions_info_by_topic(output.full_name) or not output.has_readers:
        executor.spin_once(timeout_sec=0.02)
    assert not output.matched, "one reader, but another one"

    publisher = threading.Thread(target=lambda: output.publish(kind()))
    publisher.start()
    reader.create_subscription(kind, "safety/state", lambda _: received.set(), 10)
    while not received.is_set() and rclpy.ok(context=context):
        executor.spin_once(timeout_sec=0.1)
    publisher.join(10.0)
    assert received.is_set()
    assert output.matched
    assert not publisher.is_alive()
    executor.shutdown()
    for made in (driving_system, reader, node):
        made.destroy_node()


READER = """
import rclpy
from vpsci_ros.nodes.topics import RECORDING, TOPICS

rclpy.init()
node = rclpy.create_node("recorder")
given = node.create_subscription(TOPICS["/safety/state"].type, "/safety/state", print, RECORDING)
while not given.get_publisher_count():
    rclpy.spin_once(node, timeout_sec=0.05)
print("matched", flush=True)
rclpy.spin(node)
"""


def test_a_node_that_ends_waits_until_the_recorder_has_what_it_said(context: Context) -> None:
    node = GraphNode("safety_monitor", context=context, parameter_overrides=[override("peers", ["recorder"])])
    output = node.output("/safety/state")
    reader = subprocess.Popen([sys.executable, "-c", READER], stdout=subprocess.PIPE, text=True)
    try:
        assert reader.stdout is not None
        assert "matched\n" in reader.stdout  # after what Fast DDS may have said of ports that others just opened
        output.publish(SafetyState(tick=1))
        assert output.flush(20.0), "both sides know of each other"
        reader.send_signal(signal.SIGSTOP)
        output.publish(SafetyState(tick=2))
        assert not output.flush(0.2)
        # Beside this process: a thread of it would wait for the interpreter.
        with subprocess.Popen(["sh", "-c", f"sleep 0.3; kill -CONT {reader.pid}"]):
            node.flush()
        assert output.flush(0.01)
    finally:
        reader.kill()
        reader.wait()
        reader.stdout.close()
        node.destroy_node()


@pytest.fixture
def left(domain: int) -> Iterator[Context]:
    """A context whose nodes are in the namespace /left and take the parameters of stage 3 from the package's file."""
    context = Context()
    file = str(params_dir() / "stage3_generate.yaml")
    rclpy.init(args=["--ros-args", "-r", "__ns:=/left", "--params-file", file], context=context)
    yield context
    context.try_shutdown()


def test_a_parameter_file_of_the_package_applies_in_a_namespace(left: Context) -> None:
    node = GraphNode("world_simulator", context=left)
    assert (node.config(RunConfig).episodes, node.config(RunConfig).batch) == (100, 64)
    node.destroy_node()


def test_in_a_namespace_topics_move_and_diagnostics_stay_where_aggregators_look(left: Context) -> None:
    monitor = SafetyMonitor(context=left)
    topics = {publisher.topic_name for publisher in monitor.publishers}
    assert {"/left/safety/state", "/diagnostics"} <= topics
    assert "/left/diagnostics" not in topics
    assert monitor.full_name("/world/state") == "/left/world/state"
    assert monitor.frame_prefix == "left/"
    monitor.destroy_node()


def test_a_quality_of_service_is_overridden_as_ros_2_does_it(context: Context) -> None:
    overrides = [
        override("qos_overrides./safety/state.publisher.depth", 7),
        override("qos_overrides./world/state.subscription.reliability", "best_effort"),
    ]
    monitor = SafetyMonitor(context=context, parameter_overrides=overrides)
    (written,) = (each for each in monitor.publishers if each.topic_name == "/safety/state")
    (read,) = (each for each in monitor.subscriptions if each.topic_name == "/world/state")
    assert written.qos_profile.depth == 7
    assert read.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert LOCK_STEP.depth == 1000, "other nodes of this process keep theirs"
    assert LOCK_STEP.reliability == ReliabilityPolicy.RELIABLE
    monitor.destroy_node()


FILES = sorted(params_dir().glob("*.yaml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_parameter_file_of_the_package_loads_into_every_node_that_it_names(path: Path) -> None:
    """As `ros2 run vpsci_ros NODE --ros-args --params-file FILE` has it: `[]` comes without a value."""
    sections = read_parameter_file(path)
    named = sorted(({*SECTIONS, "learner"} - {"graph"}) & set(sections))
    assert named
    context = Context()
    rclpy.init(args=["--ros-args", "--params-file", str(path)], context=context)
    try:
        for name in named:
            node = GraphNode(name, context=context)
            for key, value in sections[name].items():
                held = node.get_parameter(key).value
                assert (list(held) if isinstance(value, list) else held) == value, f"{name}.{key}"
            node.destroy_node()
    finally:
        context.try_shutdown()
