"""The qualities of service of the graph's topics agree."""

import pytest
from rclpy.qos import QoSCompatibility, qos_check_compatible

from vpsci_ros.nodes.topics import LATCHED, LOCK_STEP, RECORDING


@pytest.mark.parametrize("reader", [LOCK_STEP, RECORDING])
@pytest.mark.parametrize("writer", [LOCK_STEP, LATCHED])
def test_every_reader_can_read_every_writer(writer, reader) -> None:
    compatibility, reason = qos_check_compatible(writer, reader)
    # A warning: both leave liveliness to the middleware, so that rclpy cannot tell; reliability and durability it can.
    assert compatibility != QoSCompatibility.ERROR, reason
    assert "eliability" not in reason
    assert "urability" not in reason
