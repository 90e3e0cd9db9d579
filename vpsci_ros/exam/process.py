"""The driving system under test as a process: started with a command line, watched, and stopped."""

import contextlib
import os
import shlex
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.processes import ChildProcess, stop

OWN = "example_ads"
LEAST_FLOOD = 2000  # commands; fewer are no flood, however few the ticks


def command_of(text: str, latency: float | None = None) -> list[str]:
    """Return the command line that `text` means: no shell, `example_ads` is the package's own.

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
    """Return the files that a command line names, with their SHA-256: what was examined."""
    words = [Path(__file__).parents[1] / "nodes" / f"{OWN}.py"] if text.strip() == OWN else map(Path, shlex.split(text))
    return {word.name: sha256(word) for word in words if word.is_file()}


@contextlib.contextmanager
def running(command: list[str], log: Path) -> Iterator[ChildProcess]:
    """Start the driving system, and stop it with all that it started when the `with` block is left.

    :raises InvalidInput: the program cannot be started.
    """
    try:
        process = ChildProcess(command, log, _environment())
    except OSError as error:
        raise InvalidInput(f"--ads {shlex.join(command)}: cannot be started ({error.strerror})") from None
    try:
        yield process
    finally:
        stop([process])
        process.signal(signal.SIGKILL)  # for what it started and left behind


def failure(process: ChildProcess) -> str:
    """Return how the driving system ended, with the last line that it wrote; nothing while it runs."""
    if not process.end:
        return ""
    said = process.said()
    return f"the ADS {process.end}" + (f", having said {said!r}" if said else "") + f" (log: {process.log})"


def silence(limit: int) -> Callable[[dict[str, float]], str]:
    """Return what tells, from the world's diagnostics seen now and then, that the ADS has fallen silent.

    It has where it left `limit` ticks unanswered while it answered fewer than that.
    """
    seen = {"ticks": 0.0, "missing": 0.0, "refused": 0.0}

    def check(numbers: dict[str, float]) -> str:
        ticks = numbers.get("world_simulator.tick", 0.0)
        missing = numbers.get("world_simulator.vehicle_answers_missing", 0.0)
        if ticks < seen["ticks"] or missing - seen["missing"] < 0.5 * (ticks - seen["ticks"]):
            refused = numbers.get("world_simulator.vehicle_commands_refused", 0.0)
            seen.update(ticks=ticks, missing=missing, refused=refused)
        if missing - seen["missing"] < limit:
            return ""
        refused = numbers.get("world_simulator.vehicle_commands_refused", 0.0) - seen["refused"]
        why = f"the {refused:.0f} that came were refused: late, not finite or out of range" if refused else "none came"
        return f"the ADS gave no usable command for {missing - seen['missing']:.0f} ticks in a row; {why}"

    return check


def flood(numbers: dict[str, float], limit: int, *, late: bool) -> str:
    """Return that the ADS floods, by the world's diagnostics; nothing where it does not.

    :param limit: surplus commands a tick that are none yet.
    :param late: the first tick should have come by now.
    """
    ticks, surplus, early = (
        numbers.get(f"world_simulator.{key}", 0.0)
        for key in ("tick", "vehicle_commands_surplus", "vehicle_commands_early")
    )
    if surplus > max(limit * (ticks + 1.0), LEAST_FLOOD):
        return (
            f"the ADS floods: {surplus:.0f} commands beyond the first one of a tick in {ticks:.0f} ticks, more than "
            f"{limit} a tick (ads_test.surplus_limit)"
        )
    if late and ticks == 0.0 and early > LEAST_FLOOD:
        return f"the ADS floods: {early:.0f} commands before the first tick, which never came"
    return ""


def _environment() -> dict[str, str]:
    """Return the environment of the ADS: as this process was given it, before Python's ROS 2 wheels changed it."""
    environment = dict(os.environ)
    environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    libraries = environment.pop("LD_LIBRARY_PATH", "").split(os.pathsep)
    if own := [path for path in libraries if path and not Path(path).is_relative_to(sys.prefix)]:
        environment["LD_LIBRARY_PATH"] = os.pathsep.join(own)
    return environment
