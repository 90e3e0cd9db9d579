"""Progress of a run on standard error."""

import math
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

LINE_EVERY = 10.0  # [s] between lines where there is no terminal, at first
LATER = 0.1  # share of the time gone that passes between lines at least: every line says another time
_WORTH = ("closed_loop_ade", "held_out_closed_loop_ade", "collision_rate", "goal_rate")
_STAGE_1, _STAGE_2 = ("episode", "episodes"), ("simulated", "episodes_wanted")  # names of done and total
Own = TypeVar("Own", bound="Bars")


class Bars:
    """Progress bars; without a terminal, lines at intervals. Use it in a `with` block.

    Each line says how long the work has taken and, once a share of it is done, how long the rest takes. The remaining
    time that is said never grows: where the rest takes longer than was said, it is "at least" that long.

    :param title: what is being done, until `line` says more.
    :param quiet: show nothing.
    :param interval: seconds between lines; later `LATER` of the time gone.
    :param where: returns the names of the machines at work, for the lines; empty for this machine.
    """

    def __init__(
        self, title: str = "", *, quiet: bool = False, interval: float = LINE_EVERY, where: Callable[[], str] = str
    ) -> None:
        console = Console(stderr=True)
        self._where = where
        self._lines, self._interval = not console.is_terminal and not quiet, interval
        self._begun = self._said = time.monotonic()
        self._tasks: dict[str, TaskID] = {}
        self._shares: dict[str, tuple[float, float, float]] = {}  # done at first and now, wanted, by name
        self._lasts = 0.0  # [s] in all, by the share that was done when it last grew; 0: not known
        self._left = math.inf  # [s] as said last
        self._text, self._over = title, threading.Event()
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=16),
            TextColumn("{task.completed:,.0f}/{task.fields[wanted]}"),
            TimeRemainingColumn(compact=True, elapsed_when_finished=True),
            TextColumn("{task.fields[note]}"),
            console=console,
            disable=not console.is_terminal or quiet,
        )

    def __enter__(self: Own) -> Own:
        self._progress.start()
        if self._lines:
            self._say(f"{self._text or 'begun'}; a line follows every {self._interval:g} s, later less often")
            threading.Thread(target=self._tell, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._progress.stop()

    def _tell(self) -> None:
        """Repeat the last line, with the time, while nothing new comes."""
        while not self._over.wait(max(1.0, 0.1 * self._interval)):
            self.line(self._text)

    def _say(self, text: str) -> None:
        self._said = time.monotonic()
        print(f"  {text}", file=sys.stderr, flush=True)

    def _times(self) -> str:
        """Say how long the work has taken and, where it can be told, how long it still takes."""
        gone = time.monotonic() - self._begun
        left, said = self._lasts - gone, self._left
        if left <= 0.0:
            return f"{_duration(gone)} gone"
        self._left = min(left, said)
        return f"{_duration(gone)} gone, {'at least' if left > said else 'some'} {_duration(self._left)} left"

    def _done(self) -> str:
        """Say how much of each bar is done."""
        return ", ".join(f"{name} {done:,.0f} of {total:,.0f}" for name, (_, done, total) in self._shares.items())

    def bar(self, name: str, done: float, total: float | None, note: str = "") -> None:
        """Update the bar `name`, or add it at the first call; a `total` of None is unknown."""
        fields: dict[str, Any] = {"wanted": "?" if total is None else f"{total:,.0f}", "note": note}
        if name not in self._tasks:
            self._tasks[name] = self._progress.add_task(name, total=total, **fields)
        if total is not None:
            self._shares[name] = (self._shares.get(name, (done, done, total))[0], done, total)
            wanted = sum(total - first for first, _, total in self._shares.values())
            made = sum(done - first for first, done, _ in self._shares.values())
            self._lasts = (time.monotonic() - self._begun) * wanted / made if 0.0 < made < wanted else 0.0
        self._progress.update(self._tasks[name], completed=done, total=total, **fields)

    def clear(self) -> None:
        """Remove all bars, before other work begins."""
        self._shares.clear()
        self._begun, self._lasts, self._left = time.monotonic(), 0.0, math.inf
        while self._tasks:
            self._progress.remove_task(self._tasks.popitem()[1])

    def line(self, text: str, *, now: bool = False) -> None:
        """Without a terminal, print a line, but only if the last one is old enough or `now` is true.

        :param text: empty: how much of each bar is done.
        """
        self._text = text
        at = time.monotonic()
        pause = max(self._interval, LATER * (at - self._begun))
        if self._lines and (now or at - self._said >= pause):
            text = ", ".join(part for part in (text or self._done(), self._where()) if part)
            self._say(f"{text}; {self._times()}" if text else self._times())


def _duration(seconds: float) -> str:
    if seconds < 600.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


class StageBar(Bars):
    """The progress bar of stage 1 or stage 2 of the training."""

    def __init__(self, title: str, quiet: bool) -> None:
        super().__init__(title, quiet=quiet)
        self._title = title
        self._latest: dict[str, float] = {}

    def show(self, report: dict[str, float], title: str = "") -> None:
        """Show the latest numbers of `pretrain` or `refine`; a new `title` starts a new bar."""
        if title and title != self._title:
            self._title, self._latest = title, {}
            self.clear()
        self._latest |= report
        done, total = (report[name] for name in (_STAGE_2 if _STAGE_2[0] in report else _STAGE_1))
        known = (name for name in _WORTH if name in self._latest)
        note = ", ".join(f"{name.replace('_', ' ')} {self._latest[name]:.3g}" for name in known)
        self.bar(self._title, done, total, note)
        self.line(f"{self._title}: {done:.0f} of {total:.0f}" + (f"; {note}" if note else ""), now=done >= total)
