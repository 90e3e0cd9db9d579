"""Writes that fail: a disk that is full after n bytes, and calls that fail one after the other.

Whatever is written whole is there as it was before, or as it is now, and nothing else lies beside it. A disk that is
full is a limit on the size of files (RLIMIT_FSIZE), as the kernel enforces it, also for what libraries write in C++;
the calls are those by which a file becomes durable.
"""

import contextlib
import os
import resource
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import polars as pl
from synthetic import random_weights, synthetic_near_misses

from vpsci_ros.data.near_misses import write_near_misses
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import save_weights
from vpsci_ros.runs.files import write_json, write_text

SMALL = NetworkConfig(hidden=16, heads=2)
CALLS = ("fsync", "replace", "chmod", "open", "close")


@cache
def _near_misses() -> pl.DataFrame:
    return synthetic_near_misses(1).table


WRITERS: dict[str, Callable[[Path], None]] = {
    "text": lambda path: write_text(path, "a line\n" * 400),
    "record": lambda path: write_json(path, {"error": "", "results": list(range(300))}),
    "weights": lambda path: save_weights(path, random_weights(SMALL)),
    "near_misses": lambda path: write_near_misses(_near_misses(), path),
}


@contextlib.contextmanager
def full_after(size: int) -> Iterator[None]:
    """Let no file become larger than `size` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@contextlib.contextmanager
def failing(call: str, number: int, made: list[int]) -> Iterator[None]:
    """Have the `number`-th call of `os.<call>` fail; `made` gets the number of calls."""
    original, count = getattr(os, call), 0

    def fails(*args: Any, **kwargs: Any) -> Any:
        nonlocal count
        count += 1
        if count == number:
            raise OSError(5, "Input/output error (made up)")
        return original(*args, **kwargs)

    setattr(os, call, fails)
    try:
        yield
    finally:
        setattr(os, call, original)
        made.append(count)


def attempt(write: Callable[[Path], None], path: Path, broken: contextlib.AbstractContextManager[None]) -> bool:
    """Write in the presence of a fault; return whether that succeeded."""
    with contextlib.suppress(Exception), broken:
        write(path)
        return True
    return False


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
