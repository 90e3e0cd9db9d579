#!/usr/bin/env python
"""Write into docs/architecture.md how the rooms of the package rest upon each other, as their imports say.

    python tools/architecture.py

Named are the direct arrows alone: what a room imports through another room is left out.
"""

import ast
import graphlib
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "vpsci_ros"
PAGE = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- written by tools/architecture.py -->\n", "<!-- until here -->\n"
HALL = "hall"  # the files that belong to no room


def room_of(path: Path) -> str:
    """Return the room that a file of the package belongs to."""
    parts = path.relative_to(PACKAGE).parts
    return parts[0] if len(parts) > 1 else HALL


def arrows() -> dict[str, set[str]]:
    """Return by room the rooms that it imports, within functions and for type checking, too."""
    found: dict[str, set[str]] = {}
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    for path in sorted(set(PACKAGE.rglob("*.py")) - {PACKAGE / "__init__.py"}):
        mine = found.setdefault(room_of(path), set())
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            for name in names:
                package, *rest = name.split(".")
                if package == PACKAGE.name and rest and rest[0] != "extras":
                    mine.add(rest[0] if rest[0] in rooms else HALL)
    return {room: theirs - {room} for room, theirs in sorted(found.items())}


def direct(below: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return the arrows that no way over another room replaces.

    :raises graphlib.CycleError: rooms import each other in a circle.
    """
    reached: dict[str, set[str]] = {}
    for room in _from_the_ground_up(below):
        reached[room] = below[room].union(*(reached[other] for other in below[room]))
    return {room: theirs - set().union(*(reached[other] for other in theirs)) for room, theirs in below.items()}


def _from_the_ground_up(below: dict[str, set[str]]) -> list[str]:
    return list(graphlib.TopologicalSorter({room: sorted(theirs) for room, theirs in below.items()}).static_order())


def first_sentence(room: str) -> str:
    """Return what a room says of itself."""
    if room == HALL:
        return "Errors, parameters, documents (YAML and JSON) and resources, for all rooms."
    docstring = ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text(encoding="utf-8")))
    return (docstring or "").split("\n\n")[0].replace("\n", " ")


def written() -> str:
    """Return the table of rooms."""
    below = arrows()
    arrow = direct(below)
    rows = [
        f"| `{room}` | {', '.join(sorted(arrow[room]))} | {first_sentence(room)} |"
        for room in _from_the_ground_up(below)
    ]
    return "\n".join(["", "| room, lowest first | imports | content |", "|---|---|---|", *rows, ""])


def main() -> None:
    """Write the page's part between the marks."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}{written()}{END}{after}", encoding="utf-8")


def in_page() -> str:
    """Return what the page has between the marks."""
    match = re.search(re.escape(BEGIN) + "(.*)" + re.escape(END), PAGE.read_text(encoding="utf-8"), re.DOTALL)
    if not match:
        raise SystemExit(f"{PAGE}: expected {BEGIN!r} and {END!r} around the table")
    return match[1]


if __name__ == "__main__":
    main()
