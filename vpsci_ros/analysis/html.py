"""One HTML page that needs nothing beside it: its style, its pictures."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from vpsci_ros.provenance import written_whole

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1c1c1c; max-width: 1080px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.5em; margin-bottom: 0; } h2 { font-size: 1.15em; margin-top: 2em; border-bottom: 1px solid #ddd; }
code { background: #f3f3f1; padding: 0 .25em; } img { width: 100%; } .small, caption { color: #555; font-size: .87em; }
table { border-collapse: collapse; margin: .8em 0; font-variant-numeric: tabular-nums; font-size: .9em; }
caption { caption-side: bottom; text-align: left; padding-top: .4em; }
th, td { padding: .25em .7em; text-align: right; border-bottom: 1px solid #e8e8e8; vertical-align: top; }
th:first-child, td:first-child { text-align: left; } th { border-bottom: 2px solid #999; }
td small { color: #666; display: block; white-space: nowrap; font-weight: 400; } .sure { font-weight: 700; }
.verdict { padding: .7em 1em; border-left: 6px solid; margin: 1em 0; } .verdict ul { margin: .3em 0; }
.passed { border-color: #2e7d32; background: #eef7ee; } .failed { border-color: #b71c1c; background: #fdeeee; }
.open { border-color: #888; background: #f5f5f5; }
"""


def write_page(path: Path, title: str, parts: Iterable[str]) -> None:
    """Write a page of these parts, HTML each, whole or not at all; `title` is plain text."""
    head = f"<meta charset=utf-8><title>{escape(title)}</title><style>{STYLE}</style>"
    page = f"<!doctype html><html lang=en><head>{head}</head><body>{''.join(parts)}</body></html>\n"
    with written_whole(path) as part:
        part.write_text(page, encoding="utf-8")


def image(path: Path, caption: str) -> str:
    """Return a PNG, within the page, with its caption, which is HTML."""
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<img alt="{path.stem}" src="data:image/png;base64,{data}"><p class=small>{caption}</p>'


def table(title: str, head: Iterable[str], lines: Sequence[Sequence[str]], caption: str = "") -> str:
    """Return a table under its title, plain text; head, cells and caption are HTML. Nothing where there is no line."""
    if not lines:
        return ""
    rows = "".join("<tr><td>" + "<td>".join(line) for line in lines)
    told = f"<caption>{caption}</caption>" if caption else ""
    return f"<h2>{escape(title)}</h2><table>{told}<tr><th>{'<th>'.join(head)}{rows}</table>\n"
