"""The least change that avoids a failure, found by repeating the episode with one change at a time.

Four amounts of a factor are tried first, evenly spaced, then up to three halvings between the least amount that avoids
the failure and the largest smaller one that does not. The result is one boundary: a smaller amount between the four
might avoid the failure, too. The report says where a larger amount fails again.

The worst failure with each pedestrian comes first, then the others. At a limit of time no further run begins: what was
not tried by then is said to be so, and the same command goes on from there.
"""

import contextlib
import dataclasses
import hashlib
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data.episode import Episode, Key
from vpsci_ros.exam.exam import ADS, Exam
from vpsci_ros.exam.measures import episode_table, worst_first
from vpsci_ros.exam.result import RunResult, read_result
from vpsci_ros.exam.run import run_with
from vpsci_ros.extras.exam_extra.factors import FACTORS, Case, Span, case_of
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.workers import Workers, computed, local_workers

GRID = 4  # amounts that are tried first
HALVINGS = 3  # after them


@dataclasses.dataclass
class Search:
    """The tried amounts of one factor in one failed episode, with one pedestrian.

    :ivar failed: amount -> whether the episode failed with it, 0 for as it was.
    :ivar cut: whether the limit of time came before all amounts were tried.
    :ivar episodes: amount -> the episode that came of it.
    """

    pedestrian: str
    case: Case
    factor: str
    span: Span
    failed: dict[float, bool] = dataclasses.field(default_factory=dict)
    cut: bool = False
    episodes: dict[float, Episode] = dataclasses.field(default_factory=dict)

    def wanted(self, halving: int) -> list[float]:
        """Return the amounts to try next: first evenly spaced ones, then one between a failing and a passing amount."""
        if not self.span.most:
            return []
        if halving == 0:
            return self._new([self.span.most * (n + 1) / GRID for n in range(GRID)])
        least = self.least
        return [] if least is None else self._new([0.5 * (self.below + least)])

    def _new(self, amounts: Sequence[float]) -> list[float]:
        step = self.span.step
        rounded = [round(round(amount / step) * step if step else amount, 6) for amount in amounts]
        return [amount for amount in dict.fromkeys(rounded) if amount > 0.0 and amount not in self.failed]

    @property
    def least(self) -> float | None:
        """The least tried amount that avoids the failure; None if no tried amount does."""
        return min((amount for amount, failed in self.failed.items() if not failed), default=None)

    @property
    def below(self) -> float:
        """The largest tried amount below `least` that still fails."""
        least = math.inf if self.least is None else self.least
        return max((amount for amount, failed in self.failed.items() if failed and amount < least), default=0.0)

    def as_json(self) -> dict[str, Any]:
        """Return the search's result as JSON values."""
        least = self.least
        again = sorted(
            amount for amount, failed in self.failed.items() if failed and least is not None and amount > least
        )
        return {
            "least": least,
            "fails_at": self.below,
            "tried": {
                f"{a:g}": "fails" if failed else "avoids" for a, failed in sorted(self.failed.items()) if a > 0.0
            },
            "fails_again_at": again,
            "most": self.span.most,
            "complete": not self.cut,
            "reason": self.span.reason or self._reason(),
        }

    def _reason(self) -> str:
        found = "" if self.least is not None else "no amount that was tried avoids it"
        return ", ".join(part for part in (found, "the limit of time was reached" if self.cut else "") if part)


Unit = tuple[str, tuple[tuple[Key, float], ...]]
"""A run in which cases are driven again: factor (empty: as they were), and each case's amount of it."""


class Budget:
    """The runs of an explanation: their number, their time, and whether another one may begin.

    :param limit: seconds after which no run begins; the first one does in any case.
    """

    def __init__(self, limit: float, bars: Bars) -> None:
        self.most, self.runs, self.drives, self.reached = 0, 0, 0, False
        self._limit, self._bars, self._begun = limit, bars, time.monotonic()

    @property
    def open(self) -> bool:
        """Whether another run may begin."""
        self.reached = self.reached or (self.runs > 0 and time.monotonic() - self._begun >= self._limit)
        return not self.reached

    def count(self, drives: int) -> None:
        """Count a finished run; after the first one print the estimated total time."""
        self.runs += 1
        self.drives += drives
        self._bars.bar("runs", self.runs, max(self.runs, self.most), note=f"{self.drives} episodes driven again")
        if self.runs == 1:
            took = time.monotonic() - self._begun
            minutes = took * self.most / 60.0
            text = f"the first run took {took:.0f} s, so all take at most {minutes:.0f} min one after the other"
            self._bars.line(text, now=True)
        self._bars.line("")


def explain(
    exam: Exam,
    folder: Path,
    episodes: Mapping[str, Sequence[Episode]],
    table: pl.DataFrame,
    failures: int,
    *,
    workers: int = 1,
    limit: float = math.inf,
    quiet: bool = False,
) -> tuple[dict[str, Any], list[Search]]:
    """Repeat the worst failures of an exam; return the changes that avoid each, and all searches with episodes.

    :param folder: of the counterfactual runs; what is done there is not done again.
    :param episodes: pedestrian -> the system's episodes with it.
    :param table: a row an episode.
    :param failures: with each pedestrian, at most: the worst of them.
    :param limit: seconds after which no further run begins.
    :raises VpsciError: a node has failed.
    """
    kind = exam.config.failure
    failed = table.filter((pl.col("driver") == ADS) & pl.col("pedestrian").is_in(list(episodes)) & pl.col(kind))
    every = {name: _cases(failed.filter(pl.col("pedestrian") == name), episodes[name], failures) for name in episodes}
    chosen = {name: cases for name, cases in every.items() if cases}
    parts = [(name, cases[:1]) for name, cases in chosen.items()]
    parts += [(name, cases[1:]) for name, cases in chosen.items() if cases[1:]]
    searches: list[Search] = []
    repeats: dict[tuple[str, Key], bool] = {}
    with Bars(quiet=quiet) as bars:
        budget = Budget(limit, bars)
        groups = [_Again(exam, folder / name, name, cases, budget, workers) for name, cases in parts]
        budget.most = sum(group.most for group in groups)
        if groups:
            until = f"; none begins after {limit / 60.0:g} min" if math.isfinite(limit) else ""
            bars.line(f"{sum(map(len, chosen.values()))} failures, in at most {budget.most} runs{until}", now=True)
        for group in groups:
            if budget.open:
                mine, again = group.searched()
                searches += mine
                repeats |= {(group.pedestrian, key): known for key, known in again.items()}
    found = {
        name: {
            "failures": failed.filter(pl.col("pedestrian") == name).height,
            "analysed": [
                {"episode": case.name, "repeats": repeats[name, case.key],
                 "factors": {search.factor: search.as_json() for search in searches
                             if search.case is case}}
                for case in cases if (name, case.key) in repeats
            ],
            "not_reached": [case.name for case in cases if (name, case.key) not in repeats],
        }
        for name, cases in chosen.items()
    }  # fmt: skip
    definitions = {name: {"title": each.title, "unit": each.unit, "definition": each.definition}
                   for name, each in FACTORS.items()}  # fmt: skip
    spent = {"failures": failures, "first": GRID, "halvings": HALVINGS, "drives": budget.drives,
             "minutes": limit / 60.0 if math.isfinite(limit) else None, "limit_reached": budget.reached}  # fmt: skip
    return {"failure": kind, "budget": spent, "factors": definitions, "pedestrians": found}, searches


def _cases(failed: pl.DataFrame, episodes: Sequence[Episode], most: int) -> list[Case]:
    """Return the worst failures with a pedestrian, the worst first."""
    by_key = {episode.key: episode for episode in episodes}
    keys = worst_first(failed).head(most).select("scenario", "episode").iter_rows()
    return [case_of(by_key[key]) for key in keys]


class _Again:
    """Runs with one pedestrian in which some failures are driven again.

    :ivar most: how many runs there may be.
    """

    def __init__(
        self, exam: Exam, folder: Path, pedestrian: str, cases: Sequence[Case], budget: Budget, workers: int
    ) -> None:
        self._exam, self._folder, self.pedestrian = exam, folder, pedestrian
        self._budget, self._workers = budget, workers
        self._known = {case.key: case for case in cases}
        self._searches = [Search(pedestrian, case, name, factor.span(case, exam)) for case in cases
                          for name, factor in FACTORS.items()]  # fmt: skip
        varied = {(s.factor, s.case.key if FACTORS[s.factor].shared else None) for s in self._searches if s.span.most}
        self.most = 1 + (GRID + HALVINGS) * len(varied)
        self._pool: Workers[Unit, RunResult]

    def searched(self) -> tuple[list[Search], dict[Key, bool]]:
        """Return a search for each case and factor, and whether each case failed again when nothing was changed.

        Cases for which not even that is known, since the limit came first, are not among the latter.
        """
        job = partial(_conductor, self._exam, self._folder, self.pedestrian, self._known)
        self._pool = local_workers(job, min(self._workers, GRID * len(FACTORS)))
        with contextlib.closing(self._pool):
            control = self._unit("", [(key, 0.0) for key in self._known])
            as_it_was = {key: (fails, episode) for _, key, _, fails, episode in self._driven([control])}
            repeats = {key: key in as_it_was and as_it_was[key][0] for key in self._known}
            searches = [search for search in self._searches if search.span.most and repeats[search.case.key]]
            for search in searches:
                search.failed[0.0], search.episodes[0.0] = as_it_was[search.case.key]
            for halving in range(1 + HALVINGS):
                wanted = [(search, amount) for search in searches for amount in search.wanted(halving)]
                by = {(search.factor, search.case.key): search for search, _ in wanted}
                for factor, key, amount, fails, episode in self._driven(list(self._units_of(wanted))):
                    by[factor, key].failed[amount], by[factor, key].episodes[amount] = fails, episode
                for search, amount in wanted:
                    search.cut = search.cut or (self._budget.reached and amount not in search.failed)
        return self._searches, repeats

    def _unit(self, factor: str, amounts: Sequence[tuple[Key, float]]) -> Unit:
        return factor, tuple(sorted(amounts, key=lambda each: (each[0][1], each[0][0])))

    def _units_of(self, wanted: Sequence[tuple[Search, float]]) -> Iterator[Unit]:
        """Yield runs in which each episode comes once, and with one amount where a factor has it in common."""
        for name, factor in FACTORS.items():
            left = [(search.case.key, amount) for search, amount in wanted if search.factor == name]
            while left:
                first = left[0][1]
                now: dict[Key, float] = {}
                for key, amount in left:
                    if key not in now and (not factor.shared or amount == first):
                        now[key] = amount
                left = [each for each in left if now.get(each[0]) != each[1]]
                yield self._unit(name, list(now.items()))

    def _driven(self, units: Sequence[Unit]) -> Iterator[tuple[str, Key, float, bool, Episode]]:
        """Yield factor, episode, amount, whether it failed, and the episode that came of it."""
        waiting = iter(units)

        def following() -> Unit | None:
            return next((unit for unit in waiting if self._budget.open), None)

        for (factor, changed), result in computed(self._pool, following, ahead=False):
            rows = episode_table(result, [], driver=ADS, pedestrian=self.pedestrian)
            failed = dict(zip(rows.select("scenario", "episode").iter_rows(),
                              rows[self._exam.config.failure], strict=True))  # fmt: skip
            amounts = dict(changed)
            self._budget.count(len(result.episodes))
            for episode in result.episodes:
                yield factor, episode.key, amounts[episode.key], bool(failed[episode.key]), episode


def _conductor(exam: Exam, folder: Path, pedestrian: str, cases: Mapping[Key, Case]) -> Callable[[Unit], RunResult]:
    """Return what conducts a run of changed episodes, in a process of its own or not."""

    def conduct(unit: Unit) -> RunResult:
        factor, amounts = unit
        changed = exam.only([key for key, _ in amounts])
        if factor:
            changed = FACTORS[factor].change(changed, {key: (cases[key], amount) for key, amount in amounts})
        run_with(changed, pedestrian, folder / _name(unit))
        return read_result(folder / _name(unit), pedestrian, changed.part)

    return conduct


def _name(unit: Unit) -> str:
    """Return the name of a run's folder: equal for equal runs, however many others there are."""
    digest = hashlib.sha256(repr(unit).encode()).hexdigest()[:12]
    return f"{unit[0] or 'as_it_was'}-{digest}"
