"""The stored results of a study, so that a resumed study computes only missing ones."""

import contextlib
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from vpsci_ros.documents import read_json, require_form
from vpsci_ros.runs.files import write_json
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.workers import Place, Site, Work, computed

STATE = "study.json"
Part = TypeVar("Part")
StudyReport = Callable[[str, dict[str, float]], None]
"""Called with the name of a part of a study and with the latest numbers of its training."""


def side_by_side(
    site: Site,
    learn: Callable[[Path, Part], object],
    parts: Iterable[Part],
    folder: Path,
    report: StudyReport,
) -> None:
    """Have workers learn the parts of a study side by side, each by `learn`, which writes its results into a folder.

    A study that finds a part's results in its folder does not learn it again. Where the site is this process alone,
    nothing is done: the study learns one part after another.

    :param learn: called with a folder, in which a part leaves what it leaves in that of the study.
    :param report: called with the names of the machines at work and the number of learned parts.
    """
    todo = list(parts)
    if site.alone or not todo:
        return
    waiting, wanted = iter(todo), float(len(todo))
    pool = site.start(Work(partial(_learner, learn), folder, most=len(todo)))
    with contextlib.closing(pool):
        for done, _ in enumerate(computed(pool, lambda: next(waiting, None), ahead=False), 1):
            report(site.hosts() or "side by side", {"episode": float(done), "episodes": wanted})


def _learner(learn: Callable[[Path, Part], object], place: Place) -> Callable[[Part], None]:
    def do(part: Part) -> None:
        learn(place.folder, part)

    return do


def is_made(folder: Path) -> bool:
    """Return whether the row of `once` is stored in a folder."""
    path = folder / STATE
    return path.is_file() and read_json(path).get("row") is not None


def once(folder: Path, identity: dict[str, Any], make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return the row that `make` computes, or the stored row of an earlier run with the same `identity`.

    `study.json` in `folder` holds both: {"of": identity, "row": null until it is made}.

    :param identity: JSON values: everything that the row depends on.
    :raises InvalidInput: `folder` belongs to another identity.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / STATE
    if path.exists():
        state = read_json(path)
        require_form(state, {"of": object, "row": object}, str(path))
        require_same(path, state["of"], identity)
        if state["row"] is not None:
            done: dict[str, Any] = state["row"]
            return done
    write_json(path, {"of": identity, "row": None})
    row = make()
    write_json(path, {"of": identity, "row": row})
    return row
