"""Writes that fail: a disk that is full after n bytes.

Whatever is written whole is there as it was before, or as it is now, and nothing else lies beside it. A disk that is
full is a limit on the size of files (RLIMIT_FSIZE), as the kernel enforces it, also for what libraries write in C++.
"""

import contextlib
import resource
from collections.abc import Callable
from functools import cache
from pathlib import Path

import polars as pl
from synthetic import random_weights, synthetic_near_misses

from vpsci_ros.data.near_misses import write_near_misses
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import save_weights
from vpsci_ros.runs.files import write_json, write_text

SMALL = NetworkConfig(hidden=16, heads=2)


@cache
def _near_misses() -> pl.DataFrame:
    return synthetic_near_misses(1).table


WRITERS: dict[str, Callable[[Path], None]] = {
    "text": lambda path: write_text(path, "a line\n" * 400),
    "record": lambda path: write_json(path, {"error": "", "results": list(range(300))}),
    "weights": lambda path: save_weights(path, random_weights(SMALL)),
    "near_misses": lambda path: write_near_misses(_near_misses(), path),
}


def attempt(write: Callable[[Path], None], path: Path, size: int) -> bool:
    """Write where no file may become larger than `size` bytes; return whether that succeeded."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        with contextlib.suppress(Exception):
            write(path)
            return True
        return False
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def defects(path: Path, before: bytes | None, after: bytes, succeeded: bool) -> list[str]:
    """Return what does not hold after an attempt: the file is neither what it was nor what it is, or more lies there.

    :param before: content that the file had; None: there was none.
    """
    found = [f"left beside it: {other.name}" for other in path.parent.iterdir() if other != path]
    now = path.read_bytes() if path.exists() else None
    if now not in (before, after):
        found.append(f"half written: {len(now or b'')} of {len(after)} bytes")
    if succeeded and now != after:
        found.append("said to be written, and is not")
    return found
