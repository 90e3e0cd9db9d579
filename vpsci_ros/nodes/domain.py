"""What the middleware reads from the environment: the domain, discovery, security, and the settings of Fast DDS."""

import contextlib
import errno
import itertools
import os
import socket
from collections.abc import Iterator

import rclpy
from domain_coordinator import domain_id
from domain_coordinator.impl import PORT_BASE
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

from vpsci_ros.documents import reason
from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import params_dir

VARIABLE = "ROS_DOMAIN_ID"
LAST = 232  # domain that has ports


def set_defaults() -> None:
    """Have discovery stay on this host, and Fast DDS send heartbeats often (`params/middleware.xml`), unless set.

    Without that file it sends them every 3 s, and a node that ends waits so long for the recorder's acknowledgement.
    """
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(params_dir() / "middleware.xml"))


def require_security() -> None:
    """Refuse to start where DDS security is requested and would not be applied; nothing where it is not requested.

    By default a process that finds no keys runs unprotected, with a warning. Whether there are keys, and a middleware
    that was built with security, is found by making a node.

    :raises InvalidInput: ROS_SECURITY_STRATEGY is another one than Enforce, or no node can be made with security.
    """
    if os.environ.get("ROS_SECURITY_ENABLE") != "true":
        return
    strategy = os.environ.get("ROS_SECURITY_STRATEGY", "")
    if strategy != "Enforce":
        raise InvalidInput(
            f"ROS_SECURITY_ENABLE=true with ROS_SECURITY_STRATEGY={strategy!r}: expected 'Enforce'; with any other "
            "value, a process that finds no keys runs unprotected"
        )
    context = Context()
    try:
        rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
        rclpy.create_node("security_check", context=context, enable_rosout=False).destroy_node()
    except RuntimeError as error:
        raise InvalidInput(
            f"ROS_SECURITY_ENABLE=true, and no node can be made with DDS security: {reason(error)}; expected keys in "
            "ROS_SECURITY_KEYSTORE and a middleware that was built with security, which that of the wheels was not "
            "(docs/promises.md)"
        ) from None
    finally:
        context.try_shutdown()


@contextlib.contextmanager
def own_domain() -> Iterator[None]:
    """Run in a ROS domain that no other graph on this machine uses, and not in that of the environment.

    A port reserves it until the block is left or the process ends, however it does.
    """
    before = os.environ.get(VARIABLE)
    numbers = itertools.cycle(number for number in range(1, 101) if str(number) != before)
    reserved = contextlib.ExitStack()  # closed without the error: domain_id takes an OSError for one of its own
    os.environ[VARIABLE] = str(reserved.enter_context(domain_id(lambda: next(numbers))))
    try:
        yield
    finally:
        os.environ.pop(VARIABLE)
        os.environ |= {} if before is None else {VARIABLE: before}
        reserved.close()


@contextlib.contextmanager
def only_graph(namespace: str) -> Iterator[None]:
    """Be the only graph of this machine in the environment's domain and this namespace, and keep others' domains apart.

    :raises InvalidInput: another one runs there, or ROS_DOMAIN_ID is no number of a domain.
    """
    given = os.environ.get(VARIABLE) or "0"
    if not given.isdecimal() or int(given) > LAST:
        raise InvalidInput(f"{VARIABLE} = {given!r}: expected a number from 0 to {LAST}")
    domain = int(given)
    with socket.socket(socket.AF_UNIX) as graph, socket.socket() as port:
        try:
            graph.bind(f"\0vpsci_ros/{domain}/{namespace.strip('/')}")  # no file: it ends with the process (Linux)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            where = f"ROS domain {domain}" + (f", namespace {namespace}" if namespace else "")
            raise InvalidInput(
                f"another graph runs in {where}; wait for it, or give this one another {VARIABLE} or graph.namespace"
            ) from None
        with contextlib.suppress(OSError):  # reserved before, by `own_domain` or by a graph of another namespace
            port.bind(("", PORT_BASE + domain))
        yield
