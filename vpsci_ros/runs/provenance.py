"""The environment of a result: versions of software, and the CPU model."""

import contextlib
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from vpsci_ros import __version__

_PACKAGES = ("numpy", "numba", "torch", "polars", "safetensors", "mcap", "rosbags", "ros-jazzy-rclpy")


def software_versions() -> dict[str, str]:
    """Return the machine type, and versions of Python, this package and installed packages its results depend on."""
    versions = {"python": platform.python_version(), "machine": platform.machine(), "vpsci_ros": __version__}
    for name in _PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            versions[name] = version(name)
    return versions


def cpu_name() -> str:
    """Return the CPU model, or the machine type if it is unknown; results are bit-identical on one model."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()
