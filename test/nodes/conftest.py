"""Every test of nodes runs in a ROS domain of its own and on this host only."""

import os
from collections.abc import Iterator

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS_DOMAIN_ID that no other test uses, set in the environment of this process and its children."""
    with domain_id() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        assert os.environ["ROS_DOMAIN_ID"] == str(number)
        yield number


@pytest.fixture
def context(domain: int) -> Iterator[Context]:
    """A private context in the test's domain."""
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    yield context
    context.try_shutdown()
