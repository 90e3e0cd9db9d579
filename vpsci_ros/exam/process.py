"""The driving system under test as a process: started with a command line, watched, and stopped."""

import contextlib
import os
import shlex
import shutil
import signal
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.processes import ChildProcess, stop

OWN = "example_ads"


def command_of(text: str, latency: float | None = None) -> list[str]:
    """Split a command line into program and arguments, without a shell; `example_ads` is the package's example.

    :param latency: of the objects [s] that `example_ads` has to do with; None: it has odometry.
    :raises InvalidInput: quotes that do not close, or a program that is not there.
    """
    if text.strip() == OWN:
        objects = ["--ros-args", "-p", "objects:=true", "-p", f"objects_latency:={latency or 0.0:.6f}"]
        return [sys.executable, "-m", f"vpsci_ros.nodes.{OWN}", *(objects if latency is not None else ())]
    try:
        command = shlex.split(text)
    except ValueError as error:
        raise InvalidInput(f"--ads {text!r}: not a command line ({error})") from None
    if not command or shutil.which(command[0]) is None:
        raise InvalidInput(
            f"--ads {text!r}: no program {command[0] if command else ''!r} on the path; give a command such as "
            "'python my_ads.py' or 'ros2 run my_package my_ads', or 'external' to start it yourself"
        )
    return command


def files_of(text: str) -> dict[str, str]:
    """Return name -> SHA-256 of the files that a command line names."""
    own = [Path(__file__).parents[1] / "nodes" / name for name in (f"{OWN}.py", "example_driver.py")]
    words = own if text.strip() == OWN else map(Path, shlex.split(text))
    return {word.name: sha256(word) for word in words if word.is_file()}


@contextlib.contextmanager
def running(command: list[str], log: Path, added: Mapping[str, str] | None = None) -> Iterator[ChildProcess]:
    """Start the driving system; stop it and its children at the end of the `with` block.

    :param added: variables of its environment, besides those of this process.
    :raises InvalidInput: the program cannot be started.
    """
    try:
        process = ChildProcess(command, log, _environment() | dict(added or {}))
    except OSError as error:
        raise InvalidInput(f"--ads {shlex.join(command)}: cannot be started ({error.strerror})") from error
    try:
        yield process
    finally:
        stop([process])
        process.signal(signal.SIGKILL)  # for what it started and left behind


def failure(process: ChildProcess) -> str:
    """Return how the driving system ended, with its last output line; "" while it runs."""
    if not process.end:
        return ""
    said = process.said()
    return f"the ADS {process.end}" + (f", having said {said!r}" if said else "") + f" (log: {log_name(process.log)})"


def log_name(log: Path) -> str:
    """Return a log's name as results have it, within the exam's folder: logs/ads_walker.log."""
    return f"{log.parent.name}/{log.name}"


def _environment() -> dict[str, str]:
    """Return the environment of the ADS: as this process was given it, before Python's ROS 2 wheels changed it."""
    environment = dict(os.environ)
    environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    libraries = environment.pop("LD_LIBRARY_PATH", "").split(os.pathsep)
    if own := [path for path in libraries if path and not Path(path).is_relative_to(sys.prefix)]:
        environment["LD_LIBRARY_PATH"] = os.pathsep.join(own)
    return environment
