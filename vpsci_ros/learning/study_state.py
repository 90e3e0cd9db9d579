"""What a configuration of a study has come to, kept in its folder, so that a study goes on with what is missing."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vpsci_ros.errors import InvalidInput
from vpsci_ros.provenance import written_whole

STATE = "study.json"
_LONGEST = 200  # characters of two values that an error message quotes


def once(folder: Path, identity: dict[str, Any], make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return the row of the table that `make` makes, or that it made for the same `identity` in an earlier run.

    `study.json` in `folder` holds both: {"of": identity, "row": null until it is made}.

    :param identity: JSON values: everything that the row depends on.
    :raises InvalidInput: `folder` belongs to another identity.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / STATE
    identity = json.loads(json.dumps(identity))
    if path.exists():
        state = json.loads(path.read_text(encoding="utf-8"))
        for name, mine in identity.items():
            if state["of"].get(name) != mine:
                raise InvalidInput(
                    f"{path}: made with another {name} ({_difference(state['of'].get(name), mine)}); "
                    "choose another output folder, or delete this one to start again"
                )
        if state["row"] is not None:
            done: dict[str, Any] = state["row"]
            return done
    _write(path, {"of": identity, "row": None})
    row = make()
    _write(path, {"of": identity, "row": row})
    return row


def _difference(theirs: Any, mine: Any) -> str:
    if isinstance(theirs, dict) and isinstance(mine, dict):
        for name in mine:
            if theirs.get(name) != mine[name]:
                return f"{name}: {theirs.get(name)}, now {mine[name]}"
    quoted = f"{theirs}, now {mine}"
    return quoted if len(quoted) < _LONGEST else "too long to quote"


def _write(path: Path, state: dict[str, Any]) -> None:
    with written_whole(path) as part:
        part.write_text(json.dumps(state, indent=2) + "\n", encoding="utf-8")
