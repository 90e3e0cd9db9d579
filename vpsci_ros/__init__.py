"""Safety-critical vehicle-pedestrian interactions: learned, simulated, recorded and replayed as ROS 2 nodes."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vpsci_ros.cosim import Driver, Pedestrian, Vehicle, Walker

__all__ = ["Driver", "Pedestrian", "Vehicle", "Walker"]

__version__ = "0.1.0"

_LATE = ("Driver", "Pedestrian", "Vehicle", "Walker")  # imported when first used, so that the package imports at once


def __getattr__(name: str) -> Any:
    if name in _LATE:
        return getattr(importlib.import_module("vpsci_ros.cosim"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
