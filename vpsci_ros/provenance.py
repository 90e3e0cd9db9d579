"""What makes a result reproducible: hashes, software versions, and files that appear whole or not at all."""

import contextlib
import hashlib
import os
import platform
import tempfile
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from vpsci_ros import __version__
from vpsci_ros.errors import InvalidInput

_PACKAGES = ("numpy", "numba", "torch", "polars", "safetensors", "mcap", "rosbags", "ros-jazzy-rclpy")


def sha256(path: str | Path) -> str:
    """Return the SHA-256 of a file's content as hexadecimal digits."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def software_versions() -> dict[str, str]:
    """Return the versions of Python, this package and the packages its results depend on (absent ones left out)."""
    versions = {"python": platform.python_version(), "machine": platform.machine(), "vpsci_ros": __version__}
    for name in _PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            versions[name] = version(name)
    return versions


def cpu_name() -> str:
    """Return the kind of CPU, as far as it is known: results are the same to the bit on the same kind."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


@contextlib.contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; rename it to `path` on success, remove it on any error.

    :raises InvalidInput: the parent folder does not exist, or `path` is a folder.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise InvalidInput(f"{path}: folder {path.parent} does not exist; make it or choose another output path")
    if path.is_dir():
        raise InvalidInput(f"{path}: expected a file to write, found a folder; give the name of a file")
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def require_empty_folder(path: str | Path) -> Path:
    """Create folder `path` if need be and return it.

    :raises InvalidInput: it exists and holds anything, or is not a folder.
    """
    path = Path(path)
    if path.exists() and not path.is_dir():
        raise InvalidInput(f"{path}: expected a folder for the output, found a file; choose another path")
    if path.is_dir() and any(path.iterdir()):
        raise InvalidInput(f"{path}: the output folder is not empty; choose another one or empty it first")
    path.mkdir(parents=True, exist_ok=True)
    return path
