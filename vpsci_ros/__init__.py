"""Safety-critical vehicle-pedestrian interactions: learned, simulated, recorded and replayed as ROS 2 nodes."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vpsci_ros.cosim import Driver, Pedestrian, Vehicle, Walker
    from vpsci_ros.exam.simulation import simulate

__all__ = ["Driver", "Pedestrian", "Vehicle", "Walker", "simulate"]

__version__ = "0.1.0"

# imported when first used, so that the package imports at once
_LATE = dict.fromkeys(("Driver", "Pedestrian", "Vehicle", "Walker"), "cosim") | {"simulate": "exam.simulation"}


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    if name in _LATE:
        return getattr(importlib.import_module(f"vpsci_ros.{_LATE[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
