"""The page as one HTML file: template, style, script and episodes."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from vpsci_ros.report import html
from vpsci_ros.view.pack import Source, grounds, packed

TEMPLATES = Path(__file__).resolve().parent / "templates"
SCENE = ("data.js", "scene.js")
"""Scripts that draw an episode, for other pages too."""


def write_view(path: Path, sources: Sequence[Source], title: str) -> int:
    """Write the page, whole or not at all, and return its size in bytes.

    :param sources: at least one, each with an episode, in the order of the page's menu.
    """
    html.write_page(
        path,
        TEMPLATES / "view.html",
        title=title,
        sources=[packed(source) for source in with_unique_keys(sources)],
        grounds=grounds(sources, shipped=True),
        style=inlined("view.css"),
        script=inlined(*SCENE, "charts.js", "list.js", "changes.js", "view.js", "controls.js"),
    )
    return path.stat().st_size


def with_unique_keys(sources: Sequence[Source]) -> list[Source]:
    """Return sources with unique keys; a source with a repeated key gets a number in key and title."""
    seen: Counter[str] = Counter()
    out = []
    for source in sources:
        seen[source.key] += 1
        again = seen[source.key]
        renamed = dataclasses.replace(source, key=f"{source.key}-{again}", title=f"{source.title} {again}")
        out.append(source if again == 1 else renamed)
    return out


def inlined(*names: str) -> str:
    """Return the concatenated text of these files in `templates`."""
    return "\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in names)
