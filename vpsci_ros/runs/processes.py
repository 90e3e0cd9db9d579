"""Child processes: each with a log and a session of its own, watched, and stopped by signals."""

import contextlib
import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from vpsci_ros.runs.stop_request import REQUESTS

STEPS = ((signal.SIGINT, 5.0), (signal.SIGTERM, 5.0), (signal.SIGKILL, 5.0))  # sent, and given so long [s]


class CoreTime(NamedTuple):
    """Seconds for which a thread has run and has waited for a core; 0 if the system does not report them."""

    computed: float = 0.0
    waited: float = 0.0


def core_time(thread: str = "thread-self") -> CoreTime:
    """Return the core time of a thread; for a process's number, that of its main thread.

    :param thread: as /proc names it, such as a process's number.
    """
    with contextlib.suppress(OSError, ValueError, IndexError):
        computed, waited, *_ = (1e-9 * int(number) for number in Path(f"/proc/{thread}/schedstat").read_text().split())
        return CoreTime(computed, waited)
    return CoreTime()


def unhindered_time() -> float:
    """Return monotonic time [s] minus this thread's waiting time for a core; timeouts are counted in it."""
    return time.monotonic() - core_time().waited


class ChildProcess:
    """A child process and its children; its output is appended to its log.

    Ctrl-C does not reach it, so that this process stops it in order. If this process is killed, it gets SIGTERM.

    :param environment: all of its variables, but for those that every child gets where nobody has set them.
    :param holds_signals: SIGINT and SIGTERM wait until it takes them, as `stop_requested_by_signals` does, so that none
        cuts its imports short.
    :param inherited: file descriptors that it gets, under the same numbers.
    :raises OSError: the program cannot be started.
    """

    def __init__(
        self,
        command: Sequence[str],
        log: Path,
        environment: Mapping[str, str],
        *,
        holds_signals: bool = False,
        inherited: Collection[int] = (),
    ) -> None:
        self.log = log
        with open(log, "ab") as output:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "PYTHONUNBUFFERED": "1", **environment},
                start_new_session=True,
                pass_fds=tuple(inherited),
                preexec_fn=_prepare_holding if holds_signals else _end_with_parent,  # noqa: PLW1509 - takes no lock
            )
        self.pid = self._process.pid

    @property
    def status(self) -> int | None:
        """Exit status, negative for the signal that killed it; None while it runs."""
        return self._process.poll()

    @property
    def end(self) -> str:
        """Description of the process's end; "" while it runs."""
        status = self.status
        if status is None:
            return ""
        return f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with exit status {status}"

    def said(self, what: str = "") -> str:
        """Return the last line of the log that contains `what` (lower case), ignoring case; "" if there is none."""
        if not self.log.is_file():  # its folder was deleted or moved
            return ""
        lines = self.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return next((line.strip() for line in reversed(lines) if what in line.lower()), "")

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the process and its children."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, number)

    def wait(self, seconds: float) -> None:
        """Wait for the process's end, with a timeout [s]."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)


def stop(processes: Collection[ChildProcess], steps: Sequence[tuple[signal.Signals, float]] = STEPS) -> None:
    """Stop processes by a sequence of signals, each sent to the processes that still run."""
    for number, patience in steps:
        running = [process for process in processes if process.status is None]
        for process in running:
            process.signal(number)
        deadline = time.monotonic() + patience
        for process in running:
            process.wait(max(0.0, deadline - time.monotonic()))


def _prepare_holding() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, REQUESTS)
    _end_with_parent()


def _end_with_parent() -> None:
    """In the child: have the kernel stop it should this process be killed (Linux)."""
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGTERM)
