"""The answers of raters: reading and checking their files, as arrays of raters, scenes and sources."""

import math
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
_RANGES = {"realism": (1, 5), "confidence": (1, 4)}  # the confidence is stored in the files alone


@dataclass(frozen=True)
class Answers:
    """R raters, K scenes, three sources in the order of `SOURCES`; every rater has rated every clip.

    :ivar raters: their names, R.
    :ivar realism: float64[R, K, 3], 1 (very unrealistic) to 5 (very realistic).
    :ivar real: bool[R, K, 3], rated as a recording of real people.
    :ivar seconds: float64[R, K, 3], from the end of the clip's first showing to the judgement [s].
    :ivar clips: object[K, 3], their names.
    """

    raters: list[str]
    realism: NDArray[np.float64]
    real: NDArray[np.bool_]
    seconds: NDArray[np.float64]
    clips: NDArray[np.object_]


def read_answers(key_path: Path, paths: Sequence[Path]) -> Answers:
    """Return the answers in the raters' files, ordered by the key.

    :raises InvalidInput: a file is missing, not of this kit, incomplete, out of range, or a rater answered twice.
    """
    key = _json(key_path, "the key of a Turing test", _KEY)
    place = {name: (of["scene"], SOURCES.index(of["source"])) for name, of in key["clips"].items()}
    scenes = len({scene for scene, _ in place.values()})
    clips = np.empty((scenes, len(SOURCES)), object)
    for name, at in place.items():
        clips[at] = name
    shape = (len(paths), scenes, len(SOURCES))
    out = {name: np.full(shape, np.nan) for name in ("realism", "real", "seconds")}
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
    return Answers(raters, out["realism"], out["real"] > 0.5, out["seconds"], clips)


def _take(answer: Any, place: dict[str, tuple[int, int]], row: int, out: dict[str, Any], path: Path) -> None:
    name = answer.get("clip") if isinstance(answer, dict) else None
    if name not in place:
        raise InvalidInput(f"{path}: an answer to clip {name!r}, which the key does not have")
    at = (row, *place[name])
    if not np.isnan(out["realism"][at]):
        raise InvalidInput(f"{path}: clip {name} is answered twice")
    for quantity, (low, high) in _RANGES.items():
        value = answer.get(quantity)
        if type(value) is not int or not low <= value <= high:
            raise InvalidInput(f"{path}: clip {name}: {quantity} = {value!r}, expected a whole number {low} to {high}")
    if answer.get("judgement") not in ("real", "made"):
        raise InvalidInput(f"{path}: clip {name}: judgement = {answer.get('judgement')!r}, expected real or made")
    seconds = answer.get("seconds")
    if isinstance(seconds, bool) or not isinstance(seconds, (int, float)) or not 0.0 <= seconds < math.inf:
        raise InvalidInput(f"{path}: clip {name}: seconds = {seconds!r}, expected a time not below 0")
    out["realism"][at] = answer["realism"]
    out["real"][at] = answer["judgement"] == "real"
    out["seconds"][at] = seconds


def _json(path: Path, what: str, form: Form) -> dict[str, Any]:
    document = read_json(path)
    require_form(document, form, f"{path}: expected {what}")
    return dict(document)
