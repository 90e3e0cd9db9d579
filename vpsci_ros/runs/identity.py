"""The check that a folder holds the same run, for every command that resumes a run."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

from vpsci_ros.errors import InvalidInput

_LONGEST = 200  # characters of a value that an error message quotes
_ADVICE = "choose another output folder, or delete it to start again"


def require_same(
    where: object,
    found: Mapping[str, Any],
    mine: Mapping[str, Any],
    what: str = "holds a run",
    advice: str = _ADVICE,
    other: str = "this one",
) -> None:
    """Refuse a stored run that differs from this one in any value of `mine`.

    :param where: the file or folder that was found, the opening of the error message.
    :param found: what that run was, as JSON values; names that `mine` lacks do not count.
    :param mine: what this run is, or the `other` one; anything that JSON can write.
    :raises InvalidInput: they differ; the first difference is named.
    """
    found = {name: found.get(name) for name in mine}
    for name, old, new in _differences(found, json.loads(json.dumps(mine)), ""):
        raise InvalidInput(f"{where}: {what} with {name} = {_quoted(old)}, and {other} has {_quoted(new)}; {advice}")


def _differences(old: Any, new: Any, name: str) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys([*old, *new]):
            yield from _differences(old.get(key), new.get(key), f"{name}.{key}" if name else key)
    elif old != new:
        yield name, old, new


def _quoted(value: Any) -> str:
    if isinstance(value, str) and re.fullmatch("[0-9a-f]{64}", value):
        return f"SHA-256 {value[:8]}..."
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
