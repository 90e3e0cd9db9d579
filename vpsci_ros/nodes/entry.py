"""The executables of `ros2 run vpsci_ros`, one by the name of each node, quick to import: Ctrl-C is heard at once.

A node's own module takes a second to import, and Python would answer a Ctrl-C on the way with a traceback.
"""

import importlib
import importlib.util
from collections.abc import Callable
from functools import partial


def start(node: str) -> int:
    """Import a node and run it until it has finished or is stopped; return its exit status, 0 where it was stopped."""
    try:
        module = importlib.import_module(f"vpsci_ros.nodes.{node}")
    except KeyboardInterrupt:
        return 0
    status: int = module.main()
    return status


def __getattr__(name: str) -> Callable[[], int]:
    """Return what starts the node of this name, for the scripts that setuptools writes."""
    if importlib.util.find_spec(f"vpsci_ros.nodes.{name}") is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return partial(start, name)
