"""The packages of examples/extending, and the scenario that docs/extending.md shows."""

import re
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[2]
Install = Callable[[dict[str, str]], Path]


def example(name: str) -> dict[str, str]:
    """Return the files of a package in examples/extending: name -> text."""
    files = sorted(path for path in (ROOT / "examples" / "extending" / name).iterdir() if path.is_file())
    return {path.name: path.read_text("utf-8") for path in files}


def midblock() -> str:
    """Return the scenario that the page shows."""
    page = (ROOT / "docs" / "extending.md").read_text("utf-8")
    (text,) = re.findall(r"^`midblock.yaml`:\n\n```yaml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    return str(text)
