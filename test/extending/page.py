"""The files that docs/extending.md shows."""

import re
from collections.abc import Callable
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"
_FILE = re.compile(r"^`(?P<name>[\w.]+)`:\n\n```\w+\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
Install = Callable[[dict[str, str]], Path]


def files_of(heading: str) -> dict[str, str]:
    """Return the files that a section of the page shows: name -> text."""
    section = re.search(rf"^## {heading}\n(.*?)(?=^## |\Z)", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert section is not None, f"no section {heading!r} in {PAGE}"
    return {match["name"]: match["text"] for match in _FILE.finditer(section[1])}
