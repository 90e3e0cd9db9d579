"""The package's one exception base, and what the operating system refuses in words.

Every message says what was expected, what came, where, and what to do.
"""

import errno
import os
import re

_REMEDIES = {
    errno.ENOSPC: "free some space and try again",
    errno.EDQUOT: "free some space and try again",
    errno.EFBIG: "allow larger files (ulimit -f) and try again",
    errno.EROFS: "choose another place",
    errno.EACCES: "choose another place, or have access granted",
    errno.EPERM: "choose another place, or have access granted",
    errno.EMFILE: "allow more open files (ulimit -n) and try again",
    errno.ENOMEM: "free some memory and try again",
    errno.EAGAIN: "allow more processes (ulimit -u) and try again",
}
_NO_ROOM = "failed to map segment from shared object"  # of a library, for which the address space has no room
_WRAPPED = re.compile(r"(?:\[Errno |\(os error |\bcode: )(\d+)")  # as Python, and libraries in Rust, write it in a text


class VpsciError(Exception):
    """Base of every error that this package raises on purpose; the command line prints it without a traceback."""


class InvalidInput(VpsciError, ValueError):
    """Data, a parameter or a file is not as it has to be (also a `ValueError`)."""


class Stopped(Exception):
    """Raised by a `report` callback to stop a run, which then writes a checkpoint to go on from; no error."""


def in_words(error: BaseException) -> str:
    """Return in one line what the operating system refused; nothing where the error is of another kind.

    Libraries wrap the system's errors in their own, whose text ends in its number.
    """
    if isinstance(error, MemoryError) or (isinstance(error, ImportError) and _NO_ROOM in str(error)):
        return f"not enough memory; {_REMEDIES[errno.ENOMEM]}"
    if isinstance(error, RuntimeError) and str(error) == "can't start new thread":
        return f"no further thread; {_REMEDIES[errno.EAGAIN]}"
    wrapped = _WRAPPED.search(str(error))
    number = error.errno if isinstance(error, OSError) and error.errno else int(wrapped[1]) if wrapped else 0
    if not isinstance(error, OSError) and number not in _REMEDIES:
        return ""
    name = getattr(error, "filename", None)
    what = os.strerror(number) if number else str(error)
    return "; ".join(part for part in (f"{name}: {what}" if name else what, _REMEDIES.get(number, "")) if part)
