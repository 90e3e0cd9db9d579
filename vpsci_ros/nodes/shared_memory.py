"""Shared memory that a killed process of Fast DDS has left behind.

Fast DDS keeps each segment of its shared memory as a file, and beside it a lock file whose name ends in `_el`, which
its owner holds for as long as it lives. A segment whose lock can be taken has lost its owner. Ports, which are
files as well, are small, and taken over by the next process that needs them.
"""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

FOLDER = Path("/dev/shm")
_SEGMENT, _LOCK = "fastrtps_[0-9a-f]*", "_el"  # "port" begins with another letter


def remove_left_behind(folder: Path = FOLDER) -> list[str]:
    """Remove this user's segments of Fast DDS that no process holds any more, and return their names.

    Those of live processes are left alone.
    """
    removed = []
    for lock in sorted(folder.glob(f"{_SEGMENT}{_LOCK}")) if folder.is_dir() else ():
        with contextlib.suppress(OSError), _abandoned(lock):
            segment = lock.with_name(lock.name.removesuffix(_LOCK))
            segment.unlink(missing_ok=True)
            lock.unlink(missing_ok=True)
            removed.append(segment.name)
    return removed


@contextlib.contextmanager
def _abandoned(lock: Path) -> Iterator[None]:
    """Hold the lock on a lock file of this user, which no other process holds, in the `with` block.

    :raises OSError: another process holds it, or it is another user's.
    """
    if lock.stat().st_uid != os.getuid():
        raise PermissionError(f"{lock}: of another user")
    handle = os.open(lock, os.O_RDWR)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)
