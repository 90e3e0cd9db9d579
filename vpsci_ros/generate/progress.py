"""The progress of a generation: a bar for each scenario with kept, rejected, acceptance, rate and time left."""

import time
from collections.abc import Callable

from vpsci_ros.generate.plan import DatasetPlan, ScenarioPlan
from vpsci_ros.runs.progress import LINE_EVERY, Bars
from vpsci_ros.runs.text_table import short_name


class ProgressOfRun(Bars):
    """A bar for each scenario; without a terminal, one line for all scenarios at intervals and at the end.

    :param names: of the scenarios by number.
    :param where: returns the names of the machines at work.
    """

    def __init__(
        self,
        names: dict[int, str],
        *,
        quiet: bool = False,
        interval: float = LINE_EVERY,
        where: Callable[[], str] = str,
    ) -> None:
        super().__init__(quiet=quiet, interval=interval, where=where)
        self._names = names
        self._before: dict[int, int] | None = None

    def show(self, plan: DatasetPlan) -> None:
        """Show the present state of the plan."""
        if self._before is None:  # what an earlier run had done does not count for this one's rate
            self._before = {number: _counted(scenario) for number, scenario in plan.scenarios.items()}
        hours = max(1e-3, time.monotonic() - self._begun) / 3600.0
        kept = simulated = wanted = 0
        for number, scenario in plan.scenarios.items():
            done = _counted(scenario)
            kept, simulated, wanted = kept + done, simulated + scenario.simulated, wanted + scenario.target
            rejected = scenario.simulated - scenario.kept
            rate = (done - self._before[number]) / hours
            note = f"kept, {rejected:,} rejected, {scenario.acceptance:.0%} pass, {rate:,.0f}/h"
            self.bar(short_name(self._names[number]), done, scenario.target, note)
        rate = (kept - sum(self._before.values())) / hours
        self.line(f"{kept:,} of {wanted:,} kept, {simulated:,} simulated, {rate:,.0f} kept/h", now=plan.complete)


def _counted(scenario: ScenarioPlan) -> int:
    """Return the kept episodes of a scenario, at most its target."""
    return min(scenario.kept, scenario.target)
