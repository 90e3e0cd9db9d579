"""Environment of the middleware: the domain, discovery, security, and the settings of Fast DDS."""

import contextlib
import errno
import os
import random
import socket
from collections.abc import Iterator

import rclpy
from domain_coordinator.impl import PORT_BASE
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

from vpsci_ros.documents import reason
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.resources import params_dir

VARIABLE = "ROS_DOMAIN_ID"
LAST = 232  # domain that has ports
OWN = range(1, 101)  # domains that `own_domain` reserves
_RESERVED = "VPSCI_ROS_OWN_DOMAIN"  # tells child processes which domain is reserved for them
_EXAM = "//exam"  # in the place of a namespace, which none can be


def set_defaults() -> None:
    """Limit discovery to this host and set `params/middleware.xml` for Fast DDS, unless the environment sets them.

    Without that file Fast DDS asks for missing acknowledgements every 3 s, and a node that ends waits so long for the
    recorder's.
    """
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(params_dir() / "middleware.xml"))


def require_security() -> None:
    """Refuse to start if DDS security is requested but would not be applied.

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
    """Set and reserve a ROS domain that no other graph on this machine uses, in the `with` block.

    A socket and a port reserve it until the block is left or the process ends, however it does. Numbers are tried in
    random order, since nodes of a graph that was killed may still publish in the domain that was given up last.

    :raises VpsciError: all of `OWN` are in use.
    """
    before = {name: os.environ.get(name) for name in (VARIABLE, _RESERVED)}
    numbers = [number for number in random.SystemRandom().sample(OWN, len(OWN)) if str(number) != before[VARIABLE]]
    with contextlib.ExitStack() as kept:
        domain = next((number for number in numbers if _reserved(number, kept)), None)
        if domain is None:
            raise VpsciError(f"ROS domains {OWN[0]} to {OWN[-1]} are all in use on this machine; wait for one of them")
        os.environ |= {VARIABLE: str(domain), _RESERVED: str(domain)}
        try:
            yield
        finally:
            for name, value in before.items():
                os.environ.pop(name, None)
                os.environ |= {} if value is None else {name: value}


def _reserved(domain: int, kept: contextlib.ExitStack) -> bool:
    """Reserve a domain until `kept` is closed; return whether it was free.

    The port is that of domain_coordinator, by which other packages' tests reserve theirs. The socket comes first, so
    that `only_graph`, which finds the port in use, finds by whom.
    """
    with contextlib.ExitStack() as own:
        if not _bind(own.enter_context(socket.socket(socket.AF_UNIX)), _name(domain, _EXAM)):
            return False
        if not _bind(own.enter_context(socket.socket()), ("", PORT_BASE + domain)):
            return False
        kept.push(own.pop_all())
    return True


@contextlib.contextmanager
def only_graph(namespace: str) -> Iterator[None]:
    """Reserve the environment's domain and this namespace for one graph on this machine, in the `with` block.

    :raises InvalidInput: another one runs there, `own_domain` of another process has reserved the domain, or
        ROS_DOMAIN_ID is no number of a domain.
    """
    given = os.environ.get(VARIABLE) or "0"
    if not given.isdecimal() or int(given) > LAST:
        raise InvalidInput(f"{VARIABLE} = {given!r}: expected a number from 0 to {LAST}")
    domain, remedy = int(given), f"give this one another {VARIABLE}"
    with socket.socket(socket.AF_UNIX) as graph, socket.socket() as port, socket.socket(socket.AF_UNIX) as exam:
        if not _bind(graph, _name(domain, namespace.strip("/"))):
            where = f"ROS domain {domain}" + (f", namespace {namespace}" if namespace else "")
            raise InvalidInput(f"another graph runs in {where}; wait for it, or {remedy} or graph.namespace")
        if not _bind(port, ("", PORT_BASE + domain)) and os.environ.get(_RESERVED) != str(domain):
            # in use by `own_domain`, by a graph of another namespace, or by something else altogether
            if not _bind(exam, _name(domain, _EXAM)):
                raise InvalidInput(f"an exam or a demo runs in ROS domain {domain}; wait for it, or {remedy}")
            exam.close()
        yield


def _name(domain: int, who: str) -> str:
    """Return the name of an abstract Unix socket, which is no file and is free again when its process ends."""
    return f"\0vpsci_ros/{domain}/{who}"


def _bind(end: socket.socket, address: str | tuple[str, int]) -> bool:
    """Bind a socket to an address; return whether the address was free.

    :raises OSError: another error than an address in use.
    """
    try:
        end.bind(address)
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        return False
    return True
