"""Output folders: nobody else's while they are written, and marked where a command left them unfinished."""

import contextlib
import fcntl
import os
import time
import weakref
from collections.abc import Iterator
from pathlib import Path

from vpsci_ros.errors import InvalidInput, VpsciError, in_words
from vpsci_ros.runs.files import (
    CLAIMED,
    FAILURE,
    is_at,
    is_empty_folder,
    remove_parts,
    require_claimed,
    require_empty_folder,
)
from vpsci_ros.runs.record import RECORD, read_record, write_record


class Claim:
    """A folder that is this process's from now on until `close`; the system ends the claim of a process that dies.

    :param path: made if need be.
    :raises InvalidInput: it is no folder, or another process has claimed it.
    :raises VpsciError: it lies in an output folder that was deleted, moved or replaced.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        require_claimed(self.path)
        self.made = not self.path.exists()
        if not self.made and not self.path.is_dir():
            require_empty_folder(self.path)  # says that it is no folder
        self.path.mkdir(parents=True, exist_ok=True)
        handle = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY)
        status = os.fstat(handle)
        self._identity = status.st_dev, status.st_ino
        self._first = self._identity not in CLAIMED
        self.close = weakref.finalize(self, _release, handle, self._identity if self._first else None)
        """Give the folder up."""
        if self._first:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                self.close()
                raise InvalidInput(
                    f"{self.path}: another process is writing into this folder; wait for it, or choose another one"
                ) from None
            except OSError:  # a file system without locks
                pass
            CLAIMED[self._identity] = self.path.absolute()

    @property
    def there(self) -> bool:
        """Whether the path still names the folder that was claimed."""
        return is_at(self._identity, self.path)

    def require_there(self) -> None:
        """Refuse to go on by a path that names something else by now.

        :raises VpsciError: the folder was deleted, moved or replaced.
        """
        if not self.there:
            raise VpsciError(f"{self.path}: this folder was deleted, moved or replaced while it was being written")


def _release(handle: int, identity: tuple[int, int] | None) -> None:
    if identity is not None:
        CLAIMED.pop(identity, None)
    os.close(handle)


@contextlib.contextmanager
def output_folder(path: Path) -> Iterator[Claim]:
    """Claim the folder that a command writes, and mark what it leaves there where it fails.

    The mark, `FAILURE` with the reason, is written where no record describes the failure, and removed when the same
    command succeeds, with what an earlier one left half written when it was killed. A folder that stays empty is
    removed again.

    :raises InvalidInput: see `Claim`.
    :raises VpsciError: the folder was taken away meanwhile.
    """
    begun, claim = time.monotonic(), Claim(path)
    try:
        empty = is_empty_folder(path)
        yield claim
        claim.require_there()
        (path / FAILURE).unlink(missing_ok=True)
        remove_parts(path)
    except BaseException as error:
        claim.require_there()
        refused = isinstance(error, InvalidInput) and not empty
        if not (refused or is_empty_folder(path)):
            _mark(path, begun, in_words(error) or str(error) or "stopped on request")
        raise
    finally:
        if claim.there and claim.made and not any(path.iterdir()):
            path.rmdir()
        claim.close()


def _mark(folder: Path, begun: float, error: str) -> None:
    record = read_record(folder / RECORD)
    if record is None or not record["error"]:
        with contextlib.suppress(OSError, VpsciError):
            write_record(folder / FAILURE, begun=begun, error=error, results={}, inputs={})
