#!/usr/bin/env python
"""Write the node tables of docs/nodes.md from the code: `tools/node_tables.py` (or `--check`, which only compares)."""

import sys
from pathlib import Path

from vpsci_ros.config import SECTIONS
from vpsci_ros.nodes.topics import TOPICS
from vpsci_ros.parameters import markdown_table

PAGE = Path(__file__).parent.parent / "docs" / "nodes.md"
INTRODUCTION = """# Nodes: topics and parameters

Written from the code by `tools/node_tables.py`; a test holds it to the code. `params/*.yaml` set these parameters;
`ros2 run vpsci_ros NODE --ros-args -p NAME:=VALUE`, `vpsci node NODE --ros-args ...` and
`vpsci graph --set NODE.NAME=VALUE` override them. A name that no node has, a wrong type or a value out of range ends
the node with a message that says so.
"""


def page() -> str:
    """Return the whole page."""
    parts = [INTRODUCTION, "## Topics\n", "| topic | type | from | to | QoS |", "|---|---|---|---|---|"]
    for row in TOPICS.values():
        package = row.type.__module__.split(".")[0]
        qos = f"{row.qos.reliability.name.lower()}, {row.qos.durability.name.lower()}, depth {row.qos.depth}"
        ends = " | ".join(", ".join(f"`{n}`" for n in names) for names in (row.publishers, row.subscribers))
        parts.append(f"| `{row.name}` | {package}/{row.type.__name__} | {ends} | {qos} |")
    for node, classes in SECTIONS.items():
        parts.append(f"\n## {node}\n")
        for config in classes:
            parts += [" ".join((config.__doc__ or "").split()) + "\n", markdown_table(config), ""]
    return "\n".join(parts).replace("\n\n\n", "\n\n").rstrip() + "\n"


def main() -> int:
    """Write the page, or compare it with the code."""
    if "--check" in sys.argv[1:]:
        if PAGE.read_text(encoding="utf-8") != page():
            print(f"{PAGE.name} differs from the code; run tools/node_tables.py", file=sys.stderr)
            return 1
        return 0
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
