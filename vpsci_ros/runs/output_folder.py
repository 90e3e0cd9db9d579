"""Output folders: locked by one process while it writes them, and marked where a command failed."""

import contextlib
import fcntl
import os
import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path

from vpsci_ros.errors import InvalidInput, VpsciError, in_words
from vpsci_ros.runs.files import FAILURE, is_empty_folder, is_failure, require_empty_folder
from vpsci_ros.runs.record import RUN_RECORD, read_record, write_record

_LOCKED: set[Path] = set()  # the folders that this process has locked


class FolderLock:
    """The lock of one process on a folder until `close`, or until the process dies.

    The process may lock the same folder again; its first lock is the one that counts.

    :param path: made if need be.
    :ivar made: whether the folder is new.
    :raises InvalidInput: it is no folder, or another process has locked it.
    """

    def __init__(self, path: str | Path) -> None:
        path = Path(path)
        self.made = not path.exists()
        if not self.made and not path.is_dir():
            require_empty_folder(path)  # says that it is no folder
        path.mkdir(parents=True, exist_ok=True)
        own = path.resolve()
        self.close: Callable[[], object] = lambda: None
        """Give the folder up."""
        if own in _LOCKED:
            return
        handle = os.open(own, os.O_RDONLY | os.O_DIRECTORY)
        self.close = weakref.finalize(self, _release, handle, own)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.close()
            raise InvalidInput(
                f"{path}: another process is writing into this folder; wait for it, or choose another one"
            ) from None
        except OSError:  # a file system without locks
            pass
        _LOCKED.add(own)


def _release(handle: int, folder: Path) -> None:
    _LOCKED.discard(folder)
    os.close(handle)


@contextlib.contextmanager
def output_folder(path: Path) -> Iterator[None]:
    """Lock the folder that a command writes, and mark the folder if the command fails.

    The mark, `FAILURE` with the reason, is written where no record describes the failure, and removed when the same
    command succeeds. Refused input leaves no mark in a folder that held something before. A new folder that stays empty
    is removed again.

    :raises InvalidInput: see `FolderLock`.
    :raises VpsciError: the folder was deleted or moved meanwhile.
    """
    begun, lock = time.monotonic(), FolderLock(path)
    try:
        empty = is_empty_folder(path)
        yield
        if not path.is_dir():
            raise VpsciError(f"{path}: this folder was deleted or moved while it was being written")
        if is_failure(path / FAILURE):
            (path / FAILURE).unlink()
    except BaseException as error:
        refused = isinstance(error, InvalidInput) and not empty
        if path.is_dir() and not (refused or is_empty_folder(path)):
            _mark(path, begun, in_words(error) or str(error) or "stopped on request")
        raise
    finally:
        if lock.made and path.is_dir() and not any(path.iterdir()):
            path.rmdir()
        lock.close()


def _mark(folder: Path, begun: float, error: str) -> None:
    record = read_record(folder / RUN_RECORD)
    foreign = (folder / FAILURE).exists() and not is_failure(folder / FAILURE)
    if not foreign and (record is None or not record["error"]):
        with contextlib.suppress(OSError, VpsciError):
            write_record(folder / FAILURE, begun=begun, error=error, results={}, inputs={})
