"""An exam's failures explained: driven again in EXAM/why, with a page, and another one in which they play."""

import json
from pathlib import Path
from typing import Any

from vpsci_ros.data.parquet import read_parquet
from vpsci_ros.documents import read_json, require_form
from vpsci_ros.episodes.sources import EXAM
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.collect import joined, read_run
from vpsci_ros.exam.config import title_of
from vpsci_ros.exam.measures import COLUMNS, EPISODES
from vpsci_ros.exam.prepare import exam_of, identity_of, take_folder
from vpsci_ros.exam.report import ADS, definitions
from vpsci_ros.exam.view import exam_sources
from vpsci_ros.extras.exam_extra.failures import again_source, groups_of, why_reasons
from vpsci_ros.extras.exam_extra.why import explain
from vpsci_ros.report import html
from vpsci_ros.runs.files import write_text
from vpsci_ros.view.page import write_view
from vpsci_ros.view.sources import LIMIT

FOLDER = "why"
_TEMPLATE = Path(__file__).resolve().parent / "templates" / "why.html"


def explain_exam(folder: Path, failures: int, *, workers: int, quiet: bool) -> Path:
    """Drive the worst failures of an exam again, and return the page that says what avoids each.

    :param failures: with each pedestrian, at most.
    :raises InvalidInput: no exam that is over, or its driving system is another one now.
    :raises VpsciError: a node has failed.
    """
    table = read_parquet(folder / EPISODES, "the episodes of an exam", COLUMNS)
    stored = read_json(folder / EXAM)
    require_form(stored, {"parameters": {"*": dict}}, f"{folder / EXAM}: not what an exam writes")
    if stored.get("seat"):
        raise InvalidInput(f"{folder}: a person, or a program behind a socket, drove it, and cannot be called again")
    exam = exam_of(stored, examined=True)
    exam.engine.require_own("failures are driven again from their seed, with commands and speeds changed")
    take_folder(folder, identity_of(exam))
    parts, own = exam.parts(), folder / FOLDER
    runs = {
        name: joined([read_run(part, folder, name) for part in parts], len(exam.episodes))
        for name in exam.config.opponents
    }
    own.mkdir(exist_ok=True)
    why, searches = explain(exam, own, runs, table, failures, workers=workers, quiet=quiet)
    why["groups"] = groups_of(exam, runs, table)
    write_text(own / "report.json", json.dumps(why, indent=2, allow_nan=False) + "\n")
    driven = {ADS: lambda name: runs[name].episodes}
    sources = exam_sources(table, driven, LIMIT, print, why["failure"])
    mine = {name: [each for each in searches if each.pedestrian == name] for name in runs}
    sources += [source for name, found in mine.items() if (source := again_source(name, found))]
    write_view(own / "view.html", sources, f"Failures of {stored['ads']}")
    values: dict[str, Any] = {
        "why": why,
        "ads": stored["ads"],
        "failure": definitions(exam.config)[f"{why['failure']}_rate"]["title"],
        "titles": {name: title_of(name) for name in runs},
        "view": "view.html",
        "why_reasons": why_reasons,
        "source": folder.name,
    }
    html.write_page(own / "report.html", _TEMPLATE, title=f"Why {stored['ads']} fails", **values)
    return own / "report.html"
