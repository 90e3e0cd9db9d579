#!/usr/bin/env python
"""Write the node tables of docs/nodes.md from the code: `tools/node_tables.py` (or `--check`, which only compares)."""

import sys
from pathlib import Path

from vpsci_ros.cli.parameter_file import ELSEWHERE
from vpsci_ros.nodes.config import PeerConfig
from vpsci_ros.nodes.topics import SERVICES, TOPICS
from vpsci_ros.parameters import markdown_table

PAGE = Path(__file__).parent.parent / "docs" / "nodes.md"
INTRODUCTION = """# Nodes: topics and parameters

Written from the code by `tools/node_tables.py`; a test holds it to the code. `params/*.yaml` set these parameters;
`ros2 run vpsci_ros NODE --ros-args -p NAME:=VALUE`, `vpsci node NODE --ros-args ...` and
`vpsci graph --set NODE.NAME=VALUE` override them. A name that no node has, a wrong type or a value out of range ends
the node with a message that says so, and so does a name in a file that nothing reads in the stage that it is for: the
message names the stage that does. A name with a dot is one of a group, which a file may write as a mapping
(`noise: {start: 0.1}`). What several nodes have, such as `seed` and `noise`, stands once, in the section `/**`, which
ROS 2 gives to every node.
"""

SHARED = "every node"
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
  missed (`action_timeout`) and no learner or external driving system takes part.
- A policy that is killed and started again within `action_timeout` (the node alone, while the others wait) leaves the
  same bag: it requests the frames that it has not seen from the world and goes on as if it had been there.
  `graph.restarts` has `vpsci graph` do so by itself.
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
    tables = {
        f"{section}, {stage.name}" if section == "learner" else section: classes
        for stage in ELSEWHERE
        for section, classes in stage.sections.items()
    }
    tables = {SHARED: (PeerConfig,)} | tables
    printed: dict[type, str] = {}
    for title, classes in tables.items():
        parts.append(f"\n## {title}\n")
        for config in classes:
            if config not in printed:
                printed[config] = title
                parts += [" ".join((config.__doc__ or "").split()) + "\n", markdown_table(config), ""]
        elsewhere = dict.fromkeys(printed[config] for config in classes if printed[config] not in (SHARED, title))
        if elsewhere:
            parts.append(f"It also has parameters that stand under {' and '.join(elsewhere)}, with the same meaning.\n")
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
