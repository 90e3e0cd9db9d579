"""The stored results of a study, so that a resumed study computes only missing ones."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from vpsci_ros.documents import read_json, require_form
from vpsci_ros.policy.weights import Weights, load_weights
from vpsci_ros.runs.files import write_json
from vpsci_ros.runs.identity import require_same

STATE = "study.json"
StudyReport = Callable[[str, dict[str, float]], None]
"""Called with the name of a part of a study and with the latest numbers of its training."""


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


def trained(folder: Path, weights: str, checkpoint: str, train: Callable[[], object]) -> Weights:
    """Return the weights of a training in `folder`, which `train` runs or resumes unless it is finished.

    :param weights, checkpoint: names of its files; with a checkpoint it was stopped.
    """
    if not (folder / weights).exists() or (folder / checkpoint).exists():
        train()
    return load_weights(folder / weights)
