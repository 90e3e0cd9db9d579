"""The environment of a result: versions of software, and the CPU model."""

import contextlib
import hashlib
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


def package_digest() -> str:
    """Return a SHA-256 of all files of this package: sources, weights and recordings."""
    root, digest = Path(__file__).resolve().parents[1], hashlib.sha256()
    for path in sorted(root.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(f"{path.relative_to(root)}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def kernel_target() -> list[str]:
    """Return what numba compiles kernels for: machine, CPU and its features, which decide about their last bits."""
    from numba.core.registry import cpu_target

    return [str(text) for text in cpu_target.target_context.codegen().magic_tuple()]
