"""Explanation of an exam's failures: repeated runs in EXAM/why, a report, and a page that plays them."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vpsci_ros.documents import read_json, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.exam import ADS, ALONE, EXAM, identity_of, prepare, take_folder, title_of
from vpsci_ros.exam.measures import read_episode_table
from vpsci_ros.exam.report import definitions, rows_of
from vpsci_ros.exam.timing import head_starts, read_timing
from vpsci_ros.exam.view import exam_sources, stored_episodes
from vpsci_ros.extras.exam_extra.factors import FACTORS
from vpsci_ros.extras.exam_extra.why import Search, explain
from vpsci_ros.lockstep.engines import require_own
from vpsci_ros.report import html
from vpsci_ros.runs.files import write_text
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.view.view_page import LIMIT, Shown, Source, shown, write_view

FOLDER = "why"
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "why.html"


def explain_exam(folder: Path, failures: int, *, workers: int, quiet: bool, limit: float = math.inf) -> Path:
    """Repeat the worst failures of an exam, and return the path of the page with the changes that avoid each.

    :param failures: with each pedestrian, at most.
    :param limit: seconds after which no further run begins.
    :raises InvalidInput: no exam that is over, or its driving system is another one now.
    :raises VpsciError: a node has failed.
    """
    if not (folder / EXAM).is_file():
        raise InvalidInput(f"{folder}: no exam; expected {EXAM} in it, which `vpsci ads-test` writes")
    table = read_episode_table(folder)
    stored = read_json(folder / EXAM)
    require_form(stored, {"parameters": {"*": dict}}, f"{folder / EXAM}: not what an exam writes")
    if stored.get("seat"):
        raise InvalidInput(f"{folder}: a person, or a program behind a socket, drove it, and cannot be called again")
    report, driven = read_json(folder / "report.json"), set(rows_of(table, ADS)["pedestrian"]) - {ALONE}
    if not driven:
        failed = "; ".join(report["failures"])
        raise InvalidInput(
            f"{folder}: the system drove no episode with a pedestrian, so none is driven again; the exam said: {failed}"
        )
    exam = prepare(Sections(stored["parameters"]).changed("ads_test", {"failure": report["failure"]}))
    require_own(exam.simulator.engine, "failures are driven again from their seed, with commands and speeds changed")
    take_folder(folder, identity_of(exam))
    config = dataclasses.replace(exam.config, check_state=False)
    exam = dataclasses.replace(exam, config=config, head_starts=head_starts(read_timing(folder)))
    own = folder / FOLDER
    names = [name for name in exam.config.opponents if name in driven]
    episodes = {name: list(stored_episodes(folder, ADS, name)) for name in names}
    own.mkdir(exist_ok=True)
    why, searches = explain(exam, own, episodes, table, failures, workers=workers, limit=limit, quiet=quiet)
    write_text(own / "report.json", json.dumps(why, indent=2, allow_nan=False) + "\n")
    sources = exam_sources(table, {ADS: episodes}, LIMIT, why["failure"])
    mine = {name: [each for each in searches if each.pedestrian == name] for name in names}
    sources += [source for name, found in mine.items() if (source := again_source(name, found))]
    write_view(own / "view.html", sources, f"Failures of {stored['ads']}")
    values: dict[str, Any] = {
        "why": why,
        "ads": stored["ads"],
        "failure": definitions()[f"{why['failure']}_rate"]["title"],
        "titles": {name: title_of(name) for name in names},
        "why_reasons": why_reasons,
    }
    html.write_page(own / "report.html", _TEMPLATE, title=f"Why {stored['ads']} fails", **values)
    return own / "report.html"


def again_source(pedestrian: str, searches: Sequence[Search]) -> Source | None:
    """Return the repeated episodes with one pedestrian as a source of the page; None if there are none.

    Its `changes` say which of them belongs to which failure, factor and amount, so that the page has a slider.
    """
    shown_ones: list[Shown] = []
    changes: dict[str, list[dict[str, Any]]] = {}
    period, named = 0.0, set[str]()
    for search in searches:
        steps, factor = [], FACTORS[search.factor]
        for amount, episode in sorted(search.episodes.items(), key=lambda each: each[0]):
            name = (
                f"{search.case.name} {factor.title} by {amount:g} {factor.unit}"
                if amount
                else f"{search.case.name} as it was"
            )
            steps.append({"amount": amount, "name": name, "fails": search.failed[amount]})
            if name in named:
                continue
            named.add(name)
            renamed = dataclasses.replace(episode, listed=episode.listed._replace(name=name))
            shown_ones.append(shown(renamed))
            period = episode.period
        if steps:
            nearest = next((n for n, step in enumerate(steps) if not step["fails"]), len(steps) - 1)
            changes.setdefault(search.case.name, []).append(
                {"title": factor.title, "unit": factor.unit, "steps": steps, "nearest": nearest}
            )
    if not shown_ones:
        return None
    for each in changes.values():  # those that avoid it first
        each.sort(key=lambda change: change["steps"][change["nearest"]]["fails"])
    title = f"driven again, {title_of(pedestrian)}"
    return Source(f"why-{pedestrian}", title, period, shown_ones, len(shown_ones), changes)


def why_reasons(found: Mapping[str, Any], factor: str) -> dict[str, list[str]]:
    """Return the reasons for which a factor was not varied, each with its episodes."""
    reasons: dict[str, list[str]] = {}
    for row in found["analysed"]:
        each = row["factors"][factor]
        if row["repeats"] and not each["most"]:
            reasons.setdefault(each["reason"], []).append(row["episode"])
    return reasons
