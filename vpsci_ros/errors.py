"""The exceptions of the package, and messages for errors of the operating system.

Every message says what was expected, what came, where, and what to do.
"""

import errno
import importlib.metadata
import importlib.util
import os
import re

REMEDIES = {
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
_EXTRAS = {
    "av": "formats",
    "carla": "carla",
    "commonroad": "commonroad",
    "distributed": "cluster",
    "fiss_planner": "planner",
    "gymnasium": "rl",
    "highway_env": "highway",
    "osi3": "formats",
    "osi_utilities": "formats",
    "pettingzoo": "rl",
    "scenariogeneration": "formats",
    "sklearn": "paper",
    "stable_baselines3": "baselines",
    "threadpoolctl": "exam_extra",
    "torch": "learn",
    "tornado": "drive",
    "traci": "sumo",
}
"""Module -> the extra of this package (setup.py) that brings it."""
_NO_ROOM = "failed to map segment from shared object"  # of a library, for which the address space has no room
_WRAPPED = re.compile(r"(?:\[Errno |\(os error |\bcode: )(\d+)")  # as Python, and libraries in Rust, write it in a text


class VpsciError(Exception):
    """Base of the errors that this package reports to a user; the command line prints them without a traceback."""


class InvalidInput(VpsciError, ValueError):
    """Data, a parameter or a file is refused, as its message explains (also a `ValueError`)."""


class NotInstalled(ImportError, InvalidInput):
    """A library that the request needs is not installed (also an `ImportError`)."""


class Stopped(Exception):
    """Raised to stop a run on request, as by a `report` callback; not an error: the same command resumes the run."""


def require(*modules: str) -> None:
    """Raise `NotInstalled` if one of the optional libraries `modules` is missing.

    :param modules: that are imported later, by name.
    :raises NotInstalled: one of them is not there.
    """
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise NotInstalled(not_installed(module), name=module)


def not_installed(module: str) -> str:
    """Return a line about how to install a missing module; "" for modules of no extra of this package."""
    if module == "vpsci_msgs":
        return "vpsci_msgs, this package's ROS 2 messages, is not built: docs/install.md says how"
    if module == "rclpy" or module.endswith("_msgs"):
        return f"{module} is not installed: ROS 2 is missing, docs/install.md says how"
    extra = _EXTRAS.get(module)
    return f"{module} is not installed: pip install {packages_of(extra)}" if extra else ""


def packages_of(extra: str) -> str:
    """Return the packages that an extra of this package brings, quoted for a shell: "'pyproj<4,>=3.6'"."""
    wanted = (line.partition(";") for line in importlib.metadata.requires("vpsci_ros") or [])
    return " ".join(f"'{name.strip()}'" for name, _, marker in wanted if f'extra == "{extra}"' in marker)


def in_words(error: BaseException) -> str:
    """Return a line about an error of the operating system, a shortage or a missing module; "" for any other error.

    Libraries wrap the system's errors in their own, whose text contains the error number.
    """
    if isinstance(error, ModuleNotFoundError):
        return not_installed((error.name or "").partition(".")[0])
    if isinstance(error, MemoryError) or (isinstance(error, ImportError) and _NO_ROOM in str(error)):
        return f"not enough memory; {REMEDIES[errno.ENOMEM]}"
    no_thread = isinstance(error, RuntimeError) and str(error) == "can't start new thread"
    if no_thread or (not isinstance(error, OSError) and os.strerror(errno.EAGAIN) in str(error)):  # the second: Arrow
        return f"no further thread; {REMEDIES[errno.EAGAIN]}"
    wrapped = _WRAPPED.search(str(error))
    number = error.errno if isinstance(error, OSError) and error.errno else int(wrapped[1]) if wrapped else 0
    if not isinstance(error, OSError) and number not in REMEDIES:
        return ""
    name = getattr(error, "filename", None)
    what = os.strerror(number) if number else str(error)
    return "; ".join(part for part in (f"{name}: {what}" if name else what, REMEDIES.get(number, "")) if part)


def is_shortage(error: BaseException | None) -> bool:
    """Return whether an error says, or was raised from one that says, that memory, open files or processes ran out.

    A file that could not be read for that reason is refused though nothing is wrong with it.
    """
    remedies = tuple(REMEDIES[number] for number in (errno.ENOMEM, errno.EMFILE, errno.EAGAIN))
    return error is not None and (in_words(error).endswith(remedies) or is_shortage(error.__cause__))
