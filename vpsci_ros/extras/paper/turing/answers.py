"""The answers of raters: reading and checking their files, as arrays of raters, scenes and sources."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.documents import Form, read_json, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.turing.clips import SOURCES

_KEY = {"kit": str, "clips": {"*": {"scene": int, "source": str}}}


@dataclass(frozen=True)
class Answers:
    """R raters, K scenes, three sources in the order of `SOURCES`; every rater has rated every clip.

    :ivar raters: their names, R.
    :ivar realism: float64[R, K, 3], 1 (very unrealistic) to 5 (very realistic).
    :ivar real: bool[R, K, 3], rated as a recording of real people.
    """

    raters: list[str]
    realism: NDArray[np.float64]
    real: NDArray[np.bool_]


def read_answers(key_path: Path, paths: Sequence[Path]) -> Answers:
    """Return the answers in the raters' files, ordered by the key.

    :raises InvalidInput: a file is missing, not of this kit, incomplete, out of range, or a rater answered twice.
    """
    key = _json(key_path, "the key of a Turing test", _KEY)
    place = {name: (of["scene"], SOURCES.index(of["source"])) for name, of in key["clips"].items()}
    scenes = len({scene for scene, _ in place.values()})
    shape = (len(paths), scenes, len(SOURCES))
    out = {name: np.full(shape, np.nan) for name in ("realism", "real")}
    raters: list[str] = []
    for row, path in enumerate(paths):
        document = _json(path, "a rater's answers", {"kit": str, "answers": list})
        if document["kit"] != key["kit"]:
            raise InvalidInput(f"{path}: answers to the kit {document['kit']}, expected {key['kit']}")
        rater = str(document.get("rater", "")).strip() or path.stem
        if rater in raters:
            raise InvalidInput(f"{path}: rater {rater} is there twice; give each rater's file once")
        raters.append(rater)
        for answer in document["answers"]:
            _take(answer, place, row, out, path)
        missing = int(np.isnan(out["realism"][row]).sum())
        if missing:
            raise InvalidInput(f"{path}: {missing} of {len(place)} clips are not answered; ask {rater} to go on")
    if not raters:
        raise InvalidInput("expected the answers of at least one rater, got none")
    return Answers(raters, out["realism"], out["real"] > 0.5)


def _take(answer: Any, place: dict[str, tuple[int, int]], row: int, out: dict[str, Any], path: Path) -> None:
    name = answer.get("clip") if isinstance(answer, dict) else None
    if name not in place:
        raise InvalidInput(f"{path}: an answer to clip {name!r}, which the key does not have")
    at = (row, *place[name])
    if not np.isnan(out["realism"][at]):
        raise InvalidInput(f"{path}: clip {name} is answered twice")
    realism = answer.get("realism")
    if type(realism) is not int or not 1 <= realism <= 5:
        raise InvalidInput(f"{path}: clip {name}: realism = {realism!r}, expected a whole number 1 to 5")
    if answer.get("judgement") not in ("real", "made"):
        raise InvalidInput(f"{path}: clip {name}: judgement = {answer.get('judgement')!r}, expected real or made")
    out["realism"][at] = realism
    out["real"][at] = answer["judgement"] == "real"


def _json(path: Path, what: str, form: Form) -> dict[str, Any]:
    document = read_json(path)
    require_form(document, form, f"{path}: expected {what}")
    return dict(document)
