"""What a configuration of a study has come to, kept in its folder, so that a study goes on with what is missing."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from vpsci_ros.documents import read_json, require_form
from vpsci_ros.runs.files import write_json
from vpsci_ros.runs.folder import require_same

STATE = "study.json"


def once(folder: Path, identity: dict[str, Any], make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return the row of the table that `make` makes, or that it made for the same `identity` in an earlier run.

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
