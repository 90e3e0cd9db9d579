"""Every test of nodes runs in a ROS domain of its own and on this host only."""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest
import rclpy
from nodes.stage import Stage
from rclpy.context import Context
from synthetic import random_weights

from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import save_weights


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS_DOMAIN_ID that no other test uses, set in the environment of this process and its children."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with own_domain():
        yield int(os.environ["ROS_DOMAIN_ID"])


@pytest.fixture
def context(domain: int) -> Iterator[Context]:
    """A private context in the test's domain."""
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    yield context
    context.try_shutdown()


@pytest.fixture
def closed() -> Iterator[Callable[[Any], Any]]:
    """Return the function that takes what is to be closed after the test, and returns it."""
    with ExitStack() as stack:
        yield lambda made: stack.enter_context(closing(made))


@pytest.fixture
def stage(context: Context, closed: Callable[[Any], Any]) -> Callable[..., Stage]:
    """Return the function that puts nodes under one executor."""
    return lambda *nodes, **options: closed(Stage(context, *nodes, **options))


@pytest.fixture(scope="session")
def weights(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Random weights of small networks: what nodes do with them has to be right whatever they are."""
    path = tmp_path_factory.mktemp("weights") / "random.safetensors"
    save_weights(path, random_weights(NetworkConfig(hidden=16, heads=2)))
    return str(path)
