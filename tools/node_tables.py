#!/usr/bin/env python
"""Write docs/nodes.md, docs/parameters.md and the columns in docs/dataset.md from the code.

    python tools/node_tables.py [--check]

With `--check` it only compares, and ends with 1 where a page differs.
"""

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from vpsci_ros.cli.parameter_file import ELSEWHERE
from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS, INDEX_COLUMNS, TABLE_7
from vpsci_ros.data.parquet import Column
from vpsci_ros.exam.exam_config import ExamConfig
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

`tools/node_tables.py` writes this page from the code. [Parameters](parameters.md) lists all parameters.

The columns *from* and *to* have the nodes of a graph. They leave out driving systems (also `example_ads`), the
`replayer` and your own nodes; [ads.md](ads.md) lists what a driving system reads and publishes. The column *QoS* is
that of the publishers.
"""

PARAMETERS = """# Parameters

`tools/node_tables.py` writes this page from the code: each parameter once, by purpose. Equations, tables and
sections are those of the paper. `params/*.yaml` set parameters; `--set NODE.NAME=VALUE`, `vpsci node NODE
--ros-args -p NAME:=VALUE` and `ros2 run` override them. An unknown name, a wrong type, a value out of range, or a name
that the stage does not read ends the command with a message. A dot marks a group, which a file may write as a mapping
(`noise: {start: 0.1}`). The section `/**` of a file sets parameters of several nodes at once. "(running)" marks a
parameter that may be set while the node runs. All other values are constants in the code
(`constant(...)` in a configuration class, or a name in capitals in a module); only Python code can change them.
"""

NOTES = """
## Names, time and diagnostics

- **Namespaces.** With `-r __ns:=/left` topics and services get the prefix `/left`, as in `/left/world/state`; the
  world's time is on `/left/clock`. A node with `use_sim_time` reads the global `/clock` in any namespace: give this
  node `-r /clock:=clock`, too. `/tf`, `/tf_static` and `/diagnostics` stay global; their frames and node names have the
  namespace as prefix (`left/vehicle/base_link`). Graphs in two namespaces, or with two values of `ROS_DOMAIN_ID`, do
  not disturb each other.
- **Quality of service.** The ROS parameter `qos_overrides./TOPIC.publisher.depth` changes the depth of a publisher.
  Write `subscription` for `publisher`, and `history` or `reliability` for `depth`, to change these. Viewers may
  subscribe with any depth. The recorder and the learner keep all messages until they read them (history KEEP_ALL); the
  world subscribes to `/vehicle/cmd_accel` and `/vehicle/cmd_control` with depth 32.
- **Time.** Timers of this package run on the wall clock, so no node needs `use_sim_time`.
- **Diagnostics.** Every node of a graph publishes a report on `/diagnostics` each second of wall time, with its
  parameters and figures (of the world: `vpsci_ros/lockstep/counts.py`). Like all messages of a bag, reports are stamped
  with simulated time. The level WARN of a report means that the node waits; ERROR means that the node rejected
  messages, or that an unexpected node publishes on one of its topics. The content of reports depends on the machine. On
  one CPU model and with one version of the package, all other messages of a bag depend on parameters, scenario files
  and weights alone, as long as no answer is missing and no learner, CARLA server or external driving system takes part.
- **Composed.** `vpsci graph --composed` runs all nodes in one process, with the same topics and the same bag. Separate
  processes, the default, use several cores, and each writes a log.
- **Frames.** The world publishes odometry, transforms, `/markers` and robot descriptions only with `batch=1`,
  `/pedestrians/odometry` only with several pedestrians, and no odometry of pedestrians in a graph with `perception`.
  Frames are `map`, `vehicle/base_link` (centre of the car on the ground), `vehicle/rear_axle` and
  `pedestrian/base_link` (x in its walking direction). `rviz2 -d rviz/vpsci.rviz` and Foxglove
  (`docs/foxglove_layout.json`) show these frames.
- **End.** `world_simulator` ends after its last episode, the `replayer` at the end of its bag, and a `learner` of stage
  1 after its training. All other nodes then wait for the next `world_simulator` until Ctrl-C.
- **Network.** Discovery is limited to this machine unless `ROS_AUTOMATIC_DISCOVERY_RANGE` is set. Fast DDS reads
  `params/middleware.xml` unless `FASTRTPS_DEFAULT_PROFILES_FILE` names another file.
"""


def page() -> str:
    """Return the whole page."""
    parts = [INTRODUCTION, "## Topics\n", "| topic | type | from | to | QoS |", "|---|---|---|---|---|"]
    for row in TOPICS.values():
        package = row.type.__module__.split(".")[0]
        qos = f"{row.qos.reliability.name.lower()}, {row.qos.durability.name.lower()}"
        qos += f", depth {row.qos.depth}" if row.publishers else ""  # a driving system sets the depth of its commands
        ends = " | ".join(", ".join(f"`{n}`" for n in names) for names in (row.publishers, row.subscribers))
        parts.append(f"| `{row.name}` | {package}/{row.type.__name__} | {ends} | {qos} |")
    parts += ["\n## Services\n", "| service | type | offered by | what it does |", "|---|---|---|---|"]
    for service in SERVICES.values():
        package = service.type.__module__.split(".")[0]
        kind = f"{package}/{service.type.__name__}"
        parts.append(f"| `{service.name}` | {kind} | `{service.server}` | {service.description} |")
    parts.append(NOTES)
    return _text(parts)


GROUPS: dict[str, tuple[str, tuple[type, ...]]] = {
    "Simulated episodes and datasets": (
        "The content of a simulated episode, and the episodes that a dataset keeps.",
        (RunConfig, WorldConfig, PolicyConfig, DatasetConfig),
    ),
    "Exams of a driving system": (
        "The pedestrians of the exam, the perception of the driving system, and the criteria.",
        (ExamConfig, PerceptionConfig),
    ),
    "Graphs and bags": (
        "The nodes of a run, and how their messages are recorded and replayed.",
        (GraphConfig, PeerConfig, SimulatorConfig, RecorderConfig, ReplayerConfig),
    ),
    "Learning from your own recordings": (
        "The training data and the output folder; the last section of this page has the parameters of training.",
        (LearnerConfig,),
    ),
    "Research: how the policies learn": (
        "The networks and the parameters of their training.",
        (NetworkConfig, PretrainConfig, RefineConfig),
    ),
}
"""Section title -> sentence and configuration classes."""


def parameter_page() -> str:
    """Return the page of all parameters, each described once."""
    parts, described = [PARAMETERS], dict[str, Parameter]()
    for title, (sentence, classes) in GROUPS.items():
        parts += [f"\n## {title}\n", sentence + "\n"]
        for config in classes:
            sections = ", ".join(f"`{name}`" for name in _sections_of(config))
            rows = [row for row in table(config) if described.get(row.name) != row]
            same = len(table(config)) - len(rows)
            described |= {row.name: row for row in rows}
            parts += [f"### {config.__name__.removesuffix('Config')}\n", f"In {sections}. {_first(config)}\n"]
            parts += [f"{same} more parameters of this section are described above.\n"] if same else []
            parts += [markdown_table(rows), ""]
    return _text(parts)


def markdown_table(rows: Iterable[Parameter]) -> str:
    """Return rows of parameter tables as GitHub Markdown, for the documentation."""
    lines = ["| parameter | default | unit | range | what it sets |", "|---|---|---|---|---|"]
    for row in rows:
        bounds = "" if row.low is None and row.high is None else f"{_bound(row.low)} to {_bound(row.high)}"
        bounds = " \\| ".join(row.choices) if row.choices else bounds
        default = f"`{row.default}`" if row.default != "" else ""
        running = "" if row.read_only else " (running)"
        lines.append(f"| `{row.name}` | {default} | {row.unit} | {bounds} | {row.description}{running} |")
    return "\n".join(lines)


def _bound(value: float | None) -> str:
    return "..." if value is None else f"{value:g}"


def _sections_of(config: type) -> list[str]:
    found = (section for stage in ELSEWHERE for section, classes in stage.sections.items() if config in classes)
    return list(dict.fromkeys(found))


def _first(config: type) -> str:
    return " ".join((config.__doc__ or "").split("\n\n")[0].split())


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
