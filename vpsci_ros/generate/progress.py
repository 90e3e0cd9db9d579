"""What is seen of a run: a line per scenario with kept, rejected, acceptance, rate and time left."""

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from vpsci_ros.generate.plan import Plan


class ProgressOfRun:
    """Progress bars on standard error; without a terminal a line for all now and then.

    :param names: of the scenarios by number.
    :param interval: seconds between lines without a terminal.
    """

    def __init__(self, names: dict[int, str], *, quiet: bool = False, interval: float = 10.0) -> None:
        console = Console(stderr=True)
        self._lines = not console.is_terminal and not quiet
        self._names, self._interval = names, interval
        self._begin = self._said = time.monotonic()
        self._before: dict[int, int] | None = None
        self._bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=8),
            TextColumn("{task.completed:,.0f}/{task.total:,.0f}{task.fields[note]}"),
            TimeRemainingColumn(compact=True),
            console=console,
            disable=not console.is_terminal or quiet,
        )
        self._tasks: dict[int, TaskID] = {}

    def __enter__(self) -> "ProgressOfRun":
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bars.stop()

    def show(self, plan: Plan) -> None:
        """Bring the display up to date."""
        if self._before is None:  # what an earlier run had done does not count for this one's rate
            self._before = {number: scenario.kept for number, scenario in plan.scenarios.items()}
        hours = max(1e-3, time.monotonic() - self._begin) / 3600.0
        kept = simulated = wanted = 0
        for number, scenario in plan.scenarios.items():
            done = min(scenario.kept, scenario.target)
            kept, simulated, wanted = kept + done, simulated + scenario.simulated, wanted + scenario.target
            rejected = scenario.simulated - scenario.kept
            rate = (scenario.kept - self._before[number]) / hours
            note = f" kept, {rejected:,} rejected, {scenario.acceptance:.0%} pass, {rate:,.0f}/h"
            if number not in self._tasks:
                self._tasks[number] = self._bars.add_task(_short(self._names[number]), total=scenario.target, note=note)
            self._bars.update(self._tasks[number], completed=done, note=note)
        if self._lines and time.monotonic() - self._said >= self._interval:
            self._said = time.monotonic()
            rate = (kept - sum(self._before.values())) / hours
            left = f", {(wanted - kept) / rate * 60.0:.1f} min left" if rate > 0 else ""
            print(
                f"  {kept:,} of {wanted:,} kept, {simulated:,} simulated, {rate:,.0f} kept/h{left}",
                file=sys.stderr,
                flush=True,
            )


def _short(name: str) -> str:
    """Return a scenario's name without what all of Table 6 have in common."""
    return name.removeprefix("Location").replace("_PedCross_", " ")
