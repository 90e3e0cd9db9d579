#!/usr/bin/env python
"""Write docs/nodes.md, docs/parameters.md and the columns in docs/dataset.md from the code.

    python tools/node_tables.py [--check]

With `--check` it only compares, and ends with 1 where a page differs.
"""

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from rclpy.qos import DurabilityPolicy

from vpsci_ros.cli.parameter_file import ELSEWHERE
from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS, INDEX_COLUMNS, TABLE_7
from vpsci_ros.data.parquet import Column
from vpsci_ros.exam.exam import ExamConfig
from vpsci_ros.generate.job import DatasetConfig
from vpsci_ros.learning.training_config import LearnerConfig, PretrainConfig, RefineConfig
from vpsci_ros.lockstep.simulator_config import SimulatorConfig
from vpsci_ros.nodes.node_config import GraphConfig, RecorderConfig, ReplayerConfig
from vpsci_ros.nodes.topics import SERVICES, TOPICS
from vpsci_ros.parameters import Parameter, table
from vpsci_ros.policy.policy_config import NetworkConfig, PolicyConfig
from vpsci_ros.runs.run_config import PeerConfig, RunConfig
from vpsci_ros.world.perception import PerceptionConfig
from vpsci_ros.world.world_config import WorldConfig

DOCS = Path(__file__).parent.parent / "docs"
BEGIN, END = "<!-- written by tools/node_tables.py -->\n", "<!-- until here -->\n"
INTRODUCTION = """# Nodes: topics and services

For those who connect nodes of their own: find the topic in the table. `tools/node_tables.py` writes this page from the
code. The columns *from* and *to* have the nodes of a graph; [ads.md](ads.md) has the topics of a driving system.

## Topics

Publishers are reliable and volatile with depth 1000. The topics marked * are transient local with depth 1.
"""

PARAMETERS = """# Parameters

For those who change a setting: `--set NODE.NAME=VALUE` on the command line, `-p NAME:=VALUE` of a node, or a file like
those in `params/`. `tools/node_tables.py` writes this page from the code.

A dot marks a group (`noise: {start: 0.1}` in a file). The section `/**` of a file sets parameters of several nodes.
"(running)": may be set while the node runs.
"""

NOTES = """
## Rules

- **Namespace.** `-r __ns:=/left` gives `/left/world/state` and `/left/clock`; your nodes with `use_sim_time` need
  `-r /clock:=clock`. `/tf`, `/tf_static` and `/diagnostics` stay global, with frames such as `left/vehicle/base_link`.
- **Quality of service.** `qos_overrides./TOPIC.publisher.depth` changes a depth (also `subscription`, `history`,
  `reliability`). Recorder and learner keep all messages until they read them.
- **Time.** No node of this package needs `use_sim_time`.
- **Diagnostics.** Each node publishes a report every second. WARN: the node waits. ERROR: it rejected messages, or an
  unexpected node publishes on its topics.
- **Repeatability.** On one CPU model all messages but `/diagnostics` depend on parameters, scenario files and weights
  alone. Exceptions: missing answers, a learner, CARLA, an external driving system.
- **One process.** `vpsci graph --composed` runs all nodes in one process, with an equal bag.
- **Odometry.** The world publishes odometry, `/tf` and `/markers` only with `batch=1`. In a graph with `perception`
  pedestrians have no odometry.
- **Frames.** `map`, `vehicle/base_link` (centre of the car on the ground), `vehicle/rear_axle` and
  `pedestrian/base_link` (x in its walking direction).
- **End.** `world_simulator` ends after its episodes, the `replayer` after its bag, a `learner` of stage 1 after its
  training. The other nodes wait for the next `world_simulator`.
- **Network.** Discovery stays on this machine unless `ROS_AUTOMATIC_DISCOVERY_RANGE` is set. Fast DDS reads
  `params/middleware.xml` unless `FASTRTPS_DEFAULT_PROFILES_FILE` is set.
"""


def page() -> str:
    """Return the whole page."""
    parts = [INTRODUCTION, "| topic | type | from | to |", "|---|---|---|---|"]
    for row in TOPICS.values():
        package = row.type.__module__.split(".")[0]
        latched = " *" if row.qos.durability is DurabilityPolicy.TRANSIENT_LOCAL else ""
        ends = " | ".join(", ".join(f"`{n}`" for n in names) for names in (row.publishers, row.subscribers))
        parts.append(f"| `{row.name}`{latched} | {package}/{row.type.__name__} | {ends} |")
    parts += ["\n## Services\n", "| service | type | what it does |", "|---|---|---|"]
    for name, (kind, description) in SERVICES.items():
        parts.append(f"| `{name}` | {kind.__module__.split('.')[0]}/{kind.__name__} | {description} |")
    parts.append(NOTES)
    return _text(parts)


GROUPS: dict[str, tuple[type, ...]] = {
    "Simulated episodes and datasets": (RunConfig, WorldConfig, PolicyConfig, DatasetConfig),
    "Exams of a driving system": (ExamConfig, PerceptionConfig),
    "Graphs and bags": (GraphConfig, PeerConfig, SimulatorConfig, RecorderConfig, ReplayerConfig),
    "Learning from your own recordings": (LearnerConfig,),
    "Research: how the policies learn": (NetworkConfig, PretrainConfig, RefineConfig),
}
"""Section title -> configuration classes."""


def parameter_page() -> str:
    """Return the page of all parameters, each described once."""
    parts, described = [PARAMETERS], dict[str, Parameter]()
    for title, classes in GROUPS.items():
        parts += [f"\n## {title}\n"]
        for config in classes:
            sections = [f"`{name}`" for name in _sections_of(config)]
            where = ", ".join(sections) if len(sections) < 3 else "every node"
            rows = [row for row in table(config) if described.get(row.name) != row]
            same = len(table(config)) - len(rows)
            described |= {row.name: row for row in rows}
            parts += [
                f"### {config.__name__.removesuffix('Config')}\n",
                f"In {where}{f', besides {same} parameters that are described above' * bool(same)}:\n",
            ]
            parts += [markdown_table(rows), ""]
    return _text(parts)


def markdown_table(rows: Iterable[Parameter]) -> str:
    """Return rows of parameter tables as GitHub Markdown, for the documentation."""
    lines = ["| parameter | default | what it sets |", "|---|---|---|"]
    for row in rows:
        default = f"`{row.default}` {row.unit}".rstrip() if row.default != "" else ""
        new = [each for each in row.choices or () if each not in row.description]
        choices = f"; one of {', '.join(row.choices or ())}" if new else ""
        running = "" if row.read_only else " (running)"
        lines.append(f"| `{row.name}` | {default} | {row.description}{choices}{running} |")
    return "\n".join(lines)


def _sections_of(config: type) -> list[str]:
    found = (section for stage in ELSEWHERE for section, classes in stage.sections.items() if config in classes)
    return list(dict.fromkeys(found))


def _text(parts: list[str]) -> str:
    return "\n".join(parts).replace("\n\n\n", "\n\n").rstrip() + "\n"


def column_tables() -> str:
    """Return the columns of a scenario's file and of the index of episodes."""
    further = {name: column for name, column in EPISODE_COLUMNS.items() if name not in TABLE_7}
    parts = ["", f"A scenario's file has the columns of Table 7: {', '.join(f'`{name}`' for name in TABLE_7)}; and:\n"]
    parts += [_columns(further), "\n`episodes.parquet` has a row for each simulated episode, kept or not:\n"]
    return "\n".join([*parts, _columns(INDEX_COLUMNS), "", ""])


def _columns(columns: Mapping[str, Column]) -> str:
    units = {name: f" [{each.unit}]" if each.unit else "" for name, each in columns.items()}
    rows = (f"| `{name}` | {each.description}{units[name]} |" for name, each in columns.items())
    return "\n".join(["| column | meaning |", "|---|---|", *rows])


def dataset_page(before: str) -> str:
    """Return docs/dataset.md with the tables of columns between its marks."""
    head, begin, rest = before.partition(BEGIN)
    return head + begin + column_tables() + END + rest.partition(END)[2]


def main() -> int:
    """Write the pages, or compare them with the code."""
    dataset = dataset_page((DOCS / "dataset.md").read_text(encoding="utf-8"))
    for name, text in (("nodes.md", page()), ("parameters.md", parameter_page()), ("dataset.md", dataset)):
        path = DOCS / name
        if "--check" not in sys.argv[1:]:
            path.write_text(text, encoding="utf-8")
        elif path.read_text(encoding="utf-8") != text:
            print(f"{name} differs from the code; run tools/node_tables.py", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
