#!/usr/bin/env python
"""Write docs/nodes.md and docs/parameters.md from the code; with `--check` only compare them with it."""

import sys
from collections.abc import Iterable
from pathlib import Path

from vpsci_ros.cli.parameter_file import ELSEWHERE
from vpsci_ros.data.filters import FilterConfig
from vpsci_ros.exam.config import ExamConfig
from vpsci_ros.generate.config import DatasetConfig
from vpsci_ros.learning.config import LearnerConfig, PretrainConfig, RefineConfig, StartConfig
from vpsci_ros.nodes.config import GraphConfig, RecorderConfig, ReplayerConfig
from vpsci_ros.nodes.topics import SERVICES, TOPICS
from vpsci_ros.parameters import Parameter, table
from vpsci_ros.policy.config import NetworkConfig, PolicyConfig
from vpsci_ros.runs.config import PeerConfig, RunConfig
from vpsci_ros.world.config import WorldConfig
from vpsci_ros.world.engines import EngineConfig
from vpsci_ros.world.intervention import InterventionConfig
from vpsci_ros.world.lockstep import LockStepConfig
from vpsci_ros.world.monitor import MonitorConfig
from vpsci_ros.world.perception import PerceptionConfig
from vpsci_ros.world.safe_stop import ExternalConfig

DOCS = Path(__file__).parent.parent / "docs"
INTRODUCTION = """# Nodes: topics and services

Written from the code by `tools/node_tables.py`; a test holds it to the code. What can be set is in
[Parameters](parameters.md).
"""

PARAMETERS = """# Parameters

Every parameter once, by what it is for. Written from the code by `tools/node_tables.py`; a test holds it to the code.
`params/*.yaml` set most of them; `--set NODE.NAME=VALUE` of the commands, `vpsci node NODE --ros-args ...` and
`ros2 run vpsci_ros NODE --ros-args -p NAME:=VALUE` override them. An unknown name, a wrong type or a value out of range
ends the command with a message that says so, and so does a name in a file that nothing reads in the stage that it is
for: the message names the stage that does. A name with a dot is one of a group, which a file may write as a mapping
(`noise: {start: 0.1}`). What several nodes have, such as `seed` and `noise`, stands once, in the section `/**`, which
ROS 2 gives to every node. "(running)": may be set on the running node.
"""

NOTES = """
## Names, time and diagnostics

- Names follow the node's namespace: with `-r __ns:=/left` the state is on `/left/world/state`, simulated time on
  `/left/clock`. rclpy takes simulated time from `/clock`: in a namespace, give a node with `use_sim_time` also
  `-r /clock:=clock`. `/tf`, `/tf_static` and `/diagnostics` stay at the root, where other tools look for them; there
  frames and nodes have the namespace before their names (`left/vehicle/base_link`, `left/recorder`; `map` is one for
  all), and recorder and `vpsci graph` take those of their own graph alone. So graphs in two namespaces, or with two
  values of `ROS_DOMAIN_ID`, do not disturb each other. The package's parameter files name nodes in any namespace
  (`/**/world_simulator:`), as ROS 2 wants it; `world_simulator:` means the one without a namespace.
- `qos_overrides./TOPIC.publisher.depth` (also `subscription`; `history`, `reliability`) changes a quality of service.
- No node of this package needs `use_sim_time`; their timers run on the wall clock, so setting it stops nothing.
- Every node reports on `/diagnostics` once a second of wall time, stamped with simulated time: rates, lag in
  milliseconds, ticks missed or late, messages published and refused. They depend on the machine and differ from run to
  run; what the keys of the world's counts mean stands in `vpsci_ros/world/counts.py`. Everything else in a bag is a
  function of the parameters alone, whatever the load and the order in which nodes were started, as long as no answer is
  missed (`action_timeout`; at the first tick 10 s at least) and no learner or external driving system takes part.
- A policy that is killed and started again within `action_timeout` (the node alone, while the others wait) leaves the
  same bag: it requests the frames that it has not seen from the world and goes on as if it had been there.
  `graph.restarts` has `vpsci graph` do so by itself.
- `vpsci graph --composed` (parameter `graph.composed`) runs all nodes, the recorder among them, in one process. They
  have the same topics and leave the same bag; what they publish for each other does not go through the middleware, so
  that a tick takes a fifth of the CPU time, with or without the recorder. Choose it for many episodes on few cores,
  or where nobody else takes part. Separate processes, the default, use several cores, outlive the death of a policy
  (`graph.restarts`) and have a log each. Programs outside subscribe and publish as they do otherwise.
- With one episode at a time (`batch: 1`) the world also publishes both odometries, with `pedestrians` above 1 one a
  pedestrian on `/pedestrians/odometry` (frame `pedestrian_N/base_link`), transforms and `/markers`, for as
  long as anybody listens, and models of the car and the pedestrian. `rviz2 -d` with the package's `rviz/vpsci.rviz`
  (`rviz:=true` under launch) and Foxglove (layout: `docs/foxglove_layout.json`) show them. Frames are `map`,
  `vehicle/base_link`, the centre of the car's rectangle on the ground, `pedestrian/base_link`, whose x is where it
  walks, and `vehicle/rear_axle`.
- The world ends with its episodes; the other nodes stay, for a next world, until Ctrl-C. Discovery stays on this
  machine unless `ROS_AUTOMATIC_DISCOVERY_RANGE` says otherwise; Fast DDS is given `params/middleware.xml`, by which a
  node that ends need not wait long for the recorder, unless `FASTRTPS_DEFAULT_PROFILES_FILE` names another file.
- Where an ADS leaves the first tick unanswered for a second, the odometry of that tick and the first list of objects
  are published again, since its subscriptions may have been matched too late for them.
- Parameters marked "running" may be set on the running node (`ros2 param set`); the others are read-only.
"""


def page() -> str:
    """Return the whole page."""
    parts = [INTRODUCTION, "## Topics\n", "| topic | type | from | to | QoS |", "|---|---|---|---|---|"]
    for row in TOPICS.values():
        package = row.type.__module__.split(".")[0]
        qos = f"{row.qos.reliability.name.lower()}, {row.qos.durability.name.lower()}, depth {row.qos.depth}"
        ends = " | ".join(", ".join(f"`{n}`" for n in names) for names in (row.publishers, row.subscribers))
        parts.append(f"| `{row.name}` | {package}/{row.type.__name__} | {ends} | {qos} |")
    parts += ["\n## Services\n", "| service | type | offered by | what it does |", "|---|---|---|---|"]
    for service in SERVICES.values():
        package = service.type.__module__.split(".")[0]
        kind = f"{package}/{service.type.__name__}"
        parts.append(f"| `{service.name}` | {kind} | `{service.server}` | {service.description} |")
    parts.append(NOTES)
    return _joined(parts)


GROUPS: dict[str, tuple[str, tuple[type, ...]]] = {
    "Simulated episodes and datasets": (
        "What happens in a simulated episode, and which episodes a dataset keeps.",
        (RunConfig, WorldConfig, PolicyConfig, MonitorConfig, DatasetConfig, FilterConfig),
    ),
    "Exams of a driving system": (
        "With which pedestrians a driving system is tested, what it perceives, and how its commands are used.",
        (ExamConfig, ExternalConfig, InterventionConfig, PerceptionConfig),
    ),
    "Graphs and bags": (
        "How nodes run together, and how their messages are recorded and replayed.",
        (GraphConfig, PeerConfig, LockStepConfig, EngineConfig, RecorderConfig, ReplayerConfig),
    ),
    "Learning from your own recordings": (
        "From which near misses the policies learn, and where the weights go. Parameter files set the rest.",
        (LearnerConfig, StartConfig),
    ),
    "Research: how the policies learn": (
        "The networks and the way in which they learn.",
        (NetworkConfig, PretrainConfig, RefineConfig),
    ),
}
"""What a reader wants to set -> in one sentence, and the tables."""


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
            parts += [f"{same} more are described above, with the same defaults.\n"] if same else []
            parts += [markdown_table(rows), ""]
    return _joined(parts)


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


def _joined(parts: list[str]) -> str:
    return "\n".join(parts).replace("\n\n\n", "\n\n").rstrip() + "\n"


def main() -> int:
    """Write the pages, or compare them with the code."""
    for name, text in (("nodes.md", page()), ("parameters.md", parameter_page())):
        path = DOCS / name
        if "--check" not in sys.argv[1:]:
            path.write_text(text, encoding="utf-8")
        elif path.read_text(encoding="utf-8") != text:
            print(f"{name} differs from the code; run tools/node_tables.py", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
