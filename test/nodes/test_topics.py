"""The table of topics is a graph that can run: every reader has a writer, and their qualities of service agree."""

import pytest
from rclpy.qos import QoSCompatibility, qos_check_compatible

from vpsci_ros.nodes.node_config import EXECUTABLES, LEARNER, NODES, SECTIONS
from vpsci_ros.nodes.topics import LATCHED, LOCK_STEP, RECORDING, TOPICS, listeners, speakers


def test_every_publisher_and_subscriber_is_a_node_that_exists() -> None:
    for topic in TOPICS.values():
        assert set(topic.publishers) <= set(NODES)
        assert set(topic.subscribers) <= set(NODES)


def test_every_node_has_a_section_of_parameters() -> None:
    sections = {*SECTIONS, "learner"} - {"graph"}
    assert sections == set(EXECUTABLES) - {"example_ads", "carla_world"}, "which is as a program of anybody's is"
    assert set(NODES) < sections
    assert all(LEARNER.values())


@pytest.mark.parametrize("reader", [LOCK_STEP, RECORDING])
@pytest.mark.parametrize("writer", [LOCK_STEP, LATCHED])
def test_every_reader_can_read_every_writer(writer, reader) -> None:
    compatibility, reason = qos_check_compatible(writer, reader)
    # A warning: both leave liveliness to the middleware, so that rclpy cannot tell; reliability and durability it can.
    assert compatibility != QoSCompatibility.ERROR, reason
    assert "eliability" not in reason
    assert "urability" not in reason


def test_listeners_are_those_that_run() -> None:
    assert listeners("/world/state", ["recorder", "safety_monitor"]) == ["safety_monitor", "recorder"]
    assert listeners("/world/state", []) == []
    assert speakers("/policy/weights", ["learner", "recorder"]) == ["learner"]
    assert speakers("/policy/weights", ["recorder"]) == []
