"""The files that docs/extending.md shows."""

import re
from collections.abc import Callable
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"
_FILE = re.compile(r"^`(?P<name>[\w.]+)`:\n\n```\w+\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
_ROW = r'^\| \[[^]]*\]\(#{}\) \| `(?P<group>[\w.]+)` \| `(?P<entry>[\w-]+ = "(?P<module>\w+):\w+")` \|'
Install = Callable[[dict[str, str]], Path]


def files_of(heading: str) -> dict[str, str]:
    """Return the files that a section of the page shows, and its `pyproject.toml`: name -> text."""
    files = _shown(heading)
    anchor = heading.lower().replace(" ", "-")
    row = re.search(_ROW.format(re.escape(anchor)), PAGE.read_text("utf-8"), re.MULTILINE)
    if row is not None:
        text = _shown("The package")["pyproject.toml"].replace("vpsci_ros.importers", row["group"])
        text = text.replace('camera = "camera_tracks:CAMERA"', row["entry"]).replace("camera_tracks", row["module"])
        files["pyproject.toml"] = text.replace("camera-tracks", row["module"].replace("_", "-"))
    return files


def _shown(heading: str) -> dict[str, str]:
    section = re.search(rf"^## {heading}\n(.*?)(?=^## |\Z)", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert section is not None, f"no section {heading!r} in {PAGE}"
    return {match["name"]: match["text"] for match in _FILE.finditer(section[1])}
