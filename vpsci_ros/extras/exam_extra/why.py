"""Why a failure happened: the least change that avoids it, found by driving the episode again, one change at a time.

Four amounts of a factor are tried first, evenly spaced, then a few halvings between the least that avoids the failure
and the next less one. So what is found is *a* boundary: below it a smaller change might do, too, where the four amounts
miss it; and where a larger amount fails again, that is said.
"""

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data.episode import Episode, Key
from vpsci_ros.exam.conduct import run_with
from vpsci_ros.exam.config import title_of
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.in_graph import domain_of
from vpsci_ros.exam.measures import RunResult, episode_table, worst_first
from vpsci_ros.exam.report import ADS
from vpsci_ros.extras.exam_extra.factors import FACTORS, Case, Span, case_of
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.workers import Workers, computed, local_workers

GRID = 4  # amounts that are tried first
HALVINGS = 3  # after them


@dataclasses.dataclass
class Search:
    """The amounts of one factor that were tried in one case, with one pedestrian.

    :ivar failed: amount -> whether the episode failed with it, 0 for as it was.
    :ivar episodes: amount -> the episode that came of it.
    """

    pedestrian: str
    case: Case
    factor: str
    span: Span
    failed: dict[float, bool] = dataclasses.field(default_factory=dict)
    episodes: dict[float, Episode] = dataclasses.field(default_factory=dict)

    def wanted(self, halving: int) -> list[float]:
        """Return the amounts to try next: the first ones, or after them one between failing and not."""
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
        """The least amount of those tried that avoids the failure; None: none does."""
        return min((amount for amount, failed in self.failed.items() if not failed), default=None)

    @property
    def below(self) -> float:
        """The largest amount below it that was tried and fails."""
        least = math.inf if self.least is None else self.least
        return max((amount for amount, failed in self.failed.items() if failed and amount < least), default=0.0)

    def as_json(self) -> dict[str, Any]:
        """Return what was found as JSON values."""
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
            "reason": self.span.reason or ("" if least is not None else "no amount that was tried avoids it"),
        }


Unit = tuple[int, str, tuple[tuple[Key, float], ...]]
"""A run in which cases are driven again: number, factor (empty: as they were), and each case's amount of it."""


def explain(
    exam: Exam,
    folder: Path,
    runs: Mapping[str, RunResult],
    table: pl.DataFrame,
    failures: int,
    *,
    workers: int = 1,
    quiet: bool = False,
) -> tuple[dict[str, Any], list[Search]]:
    """Drive the worst failures of an exam again, and return what avoids each, and every search with its episodes.

    :param folder: of the counterfactual runs; what is done there is not done again.
    :param runs: pedestrian -> the system's run with it.
    :param table: a row an episode.
    :param failures: with each pedestrian, at most: the worst of them.
    :raises VpsciError: a node has failed.
    """
    kind = exam.config.failure
    found: dict[str, Any] = {}
    searches: list[Search] = []
    drives = 0
    for name in exam.config.opponents:
        rows = table.filter((pl.col("driver") == ADS) & (pl.col("pedestrian") == name) & pl.col(kind))
        chosen = worst_first(rows).head(failures)
        episodes = {episode.key: episode for episode in runs[name].episodes} if name in runs else {}
        keys = [(int(s), int(e)) for s, e in chosen.select("scenario", "episode").iter_rows()]
        cases = [case_of(episodes[key]) for key in keys if key in episodes]
        if not cases:
            continue
        again = _Again(exam, folder / name, name, workers=workers, quiet=quiet)
        mine, repeats = again.searched(cases)
        searches += mine
        drives += again.drives
        found[name] = {
            "failures": rows.height,
            "analysed": [
                {"episode": case.name, "repeats": repeats[case.key],
                 "factors": {search.factor: search.as_json() for search in mine if search.case is case}}
                for case in cases
            ],
        }  # fmt: skip
    definitions = {name: {"title": each.title, "unit": each.unit, "definition": each.definition}
                   for name, each in FACTORS.items()}  # fmt: skip
    budget = {"failures": failures, "first": GRID, "halvings": HALVINGS, "drives": drives}
    return {"failure": kind, "budget": budget, "factors": definitions, "pedestrians": found}, searches


class _Again:
    """Runs with one pedestrian in which failures are driven again.

    :ivar drives: episodes that were driven.
    """

    def __init__(self, exam: Exam, folder: Path, pedestrian: str, *, workers: int, quiet: bool) -> None:
        self._exam, self._folder, self._pedestrian = exam, folder, pedestrian
        self._workers, self._quiet = workers, quiet
        self._units = 0
        self.drives = 0
        self._pool: Workers[Unit, RunResult]

    def searched(self, cases: Sequence[Case]) -> tuple[list[Search], dict[Key, bool]]:
        """Return a search for each case and factor, and whether each case failed again when nothing was changed."""
        searches = [Search(self._pedestrian, case, name, factor.span(case, self._exam)) for case in cases
                    for name, factor in FACTORS.items()]  # fmt: skip
        known = {case.key: case for case in cases}
        job = partial(_conductor, self._exam, self._folder, self._pedestrian, known)
        self._pool = local_workers(job, min(self._workers, GRID * len(FACTORS)))
        with contextlib.closing(self._pool), Bars(quiet=self._quiet) as bars:
            control = self._unit("", [(case.key, 0.0) for case in cases])
            as_it_was = {key: (fails, episode) for _, key, _, fails, episode in self._driven([control])}
            repeats = {key: key in as_it_was and as_it_was[key][0] for key in known}
            for search in searches:
                if search.span.most and repeats[search.case.key]:
                    search.failed[0.0], search.episodes[0.0] = as_it_was[search.case.key]
            for halving in range(1 + HALVINGS):
                wanted = [(search, amount) for search in searches if repeats[search.case.key]
                          for amount in search.wanted(halving)]  # fmt: skip
                by = {(search.factor, search.case.key): search for search, _ in wanted}
                for factor, key, amount, fails, episode in self._driven(list(self._units_of(wanted))):
                    by[factor, key].failed[amount], by[factor, key].episodes[amount] = fails, episode
                what = f"why, {title_of(self._pedestrian)}"
                bars.bar(what, halving + 1, 1 + HALVINGS, note=f"{self.drives} episodes driven again")
        return searches, repeats

    def _unit(self, factor: str, amounts: Sequence[tuple[Key, float]]) -> Unit:
        self._units += 1
        return self._units, factor, tuple(sorted(amounts, key=lambda each: (each[0][1], each[0][0])))

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
        for (_, factor, changed), result in computed(self._pool, lambda: next(waiting, None), ahead=0):
            rows = episode_table(result, [], self._exam.config, driver=ADS, pedestrian=self._pedestrian)
            failed = dict(zip(rows.select("scenario", "episode").iter_rows(),
                              rows[self._exam.config.failure], strict=True))  # fmt: skip
            amounts = dict(changed)
            self.drives += len(result.episodes)
            for episode in result.episodes:
                yield factor, episode.key, amounts[episode.key], bool(failed[episode.key]), episode


def _conductor(exam: Exam, folder: Path, pedestrian: str, cases: Mapping[Key, Case]) -> Callable[[Unit], RunResult]:
    """Return what conducts a run of changed episodes, in a process of its own or not."""

    def conduct(unit: Unit) -> RunResult:
        number, factor, amounts = unit
        changed = exam.only([key for key, _ in amounts])
        if factor:
            changed = FACTORS[factor].change(changed, {key: (cases[key], amount) for key, amount in amounts})
        with domain_of(exam):
            return run_with(changed, pedestrian, folder / f"{number}-{factor or 'as_it_was'}", "", quiet=True)

    return conduct
