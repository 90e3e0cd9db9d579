"""The executables of `ros2 run vpsci_ros`, one for each node; they import quickly, so that Ctrl-C works at once.

A node's own module takes a second to import, and Python would answer a Ctrl-C on the way with a traceback.
`python -m vpsci_ros.nodes NODE` and `vpsci node NODE` start the same node.
"""

import importlib
import importlib.util
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

from vpsci_ros.errors import in_words

_MODULES = dict.fromkeys(("vehicle_policy", "pedestrian_policy"), "agent_policy")
"""Node -> its module, where that has another name."""


def node_class(name: str) -> Any:
    """Return the class of a node, such as `WorldSimulator` of "world_simulator", or the class "module:Class"."""
    where, _, kind = name.partition(":")
    if kind:
        return getattr(importlib.import_module(where), kind)
    module = importlib.import_module(f"vpsci_ros.nodes.{_MODULES.get(name, name)}")
    return getattr(module, "".join(part.capitalize() for part in name.split("_")))


def start(name: str, args: list[str] | None = None) -> int:
    """Run a node, or several in one process, until it has finished or is stopped; return the exit status.

    0 if it is stopped while it is imported, 2 if a library that it needs is not installed; else as `run_together`.

    :param name: of the node; "world_simulator,safety_monitor" for several in this process, until the first one has
        finished.
    :param args: as of a command line, the program's name first; None: this process's.
    """
    try:
        kinds = [node_class(each) for each in name.split(",")]
        from vpsci_ros.nodes import base, example_ads
    except KeyboardInterrupt:
        return 0
    except ModuleNotFoundError as error:
        if not (text := in_words(error)):
            raise
        print(f"error: {text}", file=sys.stderr)
        return 2
    return example_ads.main(args) if name == "example_ads" else base.run_together(kinds, args)


def __getattr__(name: str) -> Callable[[], int]:
    """Return the function that starts the node of this name, for the scripts that setuptools writes."""
    if importlib.util.find_spec(f"vpsci_ros.nodes.{_MODULES.get(name, name)}") is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return partial(start, name)
