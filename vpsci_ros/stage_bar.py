"""The progress of a stage of learning on standard error, and where it may be interrupted."""

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from vpsci_ros.learning.pretrain import Stopped

_WORTH = ("closed_loop_ade", "held_out_closed_loop_ade", "collision_rate", "goal_rate", "rollbacks")


class StageBar:
    """A progress bar of a stage; lines now and then where there is no terminal."""

    def __init__(self, title: str, quiet: bool) -> None:
        console = Console(stderr=True)
        self._lines = not console.is_terminal and not quiet
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        last = (TimeRemainingColumn(), TextColumn("{task.fields[note]}"))
        self._bar = Progress(*columns, *last, console=console, disable=not console.is_terminal or quiet)
        self._title = title
        self._task = self._bar.add_task(title, total=None, note="")
        self._latest: dict[str, float] = {}
        self._said = 0

    def __enter__(self) -> "StageBar":
        self._bar.start()
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._bar.stop()

    def show(self, report: dict[str, float], title: str = "") -> None:
        """Take the latest numbers of `pretrain` or `refine` in; another `title` than before begins anew."""
        if title and title != self._title:
            self._title, self._latest, self._said = title, {}, 0
            self._bar.reset(self._task, description=title)
        self._latest |= report
        done, total = (report[name] for name in (_STAGE_2 if _STAGE_2[0] in report else _STAGE_1))
        note = ", ".join(
            f"{name.replace('_', ' ')} {self._latest[name]:.3g}" for name in _WORTH if name in self._latest
        )
        self._bar.update(self._task, completed=done, total=total, note=note)
        tenth = int(10 * done / total)
        if self._lines and tenth > self._said:
            self._said = tenth
            told = f"; {note}" if note else ""
            print(f"  {self._title}: {done:.0f} of {total:.0f}{told}", file=sys.stderr, flush=True)


_STAGE_1, _STAGE_2 = ("episode", "episodes"), ("simulated", "episodes_wanted")  # names of done and total


@contextlib.contextmanager
def stopped_between_updates() -> Iterator[Callable[[], None]]:
    """Hold Ctrl-C and SIGTERM back, and yield what raises `Stopped` once one came: call it between two updates.

    A run that is torn out of an update could not go on to the same result.
    """
    asked = threading.Event()
    before = {number: signal.signal(number, lambda *_: asked.set()) for number in (signal.SIGINT, signal.SIGTERM)}

    def check() -> None:
        if asked.is_set():
            raise Stopped

    try:
        yield check
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
