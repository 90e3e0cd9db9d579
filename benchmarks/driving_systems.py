"""The tables of docs/driving_systems.md: four driving systems on the same episodes, and their paired differences.

    python benchmarks/driving_systems.py OUT [--episodes 1002] [--systems example trained planner] [--harder plain ...]

The systems drive in this process, by `--ads-class`; the rule-based autopilot is the comparison of each exam. The
policy is trained first, in OUT, unless it is there. Runs that are done are not driven again, so that a system can be
given fewer episodes in a folder of its own. The tables are printed as Markdown and written to OUT/tables.md.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.cli.options import read_sections
from vpsci_ros.exam.config import title_of
from vpsci_ros.exam.measures import EPISODES
from vpsci_ros.exam.report import ADS, BASELINE, differences
from vpsci_ros.exam.run import prepare, run_exam
from vpsci_ros.exam.scores import DIFFERENCES, MEASURES, estimate
from vpsci_ros.policy.config import LEARNED
from vpsci_ros.resources import params_path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
SYSTEMS = {
    "example": ("`example_ads`", "vpsci_ros.nodes.example_driver:ExampleDriver"),
    "trained": ("trained policy", "trained_policy:PolicyDriver"),
    "planner": ("motion planner", "motion_planner:PlannerDriver"),
}
AUTOPILOT = "rule-based autopilot"
PEDESTRIANS = (LEARNED, "walker")
SHOWN = ("collision_rate", "moving_collision_rate", "conflict_rate", "hard_braking_rate", "time_lost")
_KINDS = [f"world_simulator.kinds.{kind}=1.0" for kind in ("older", "child", "distracted", "wheelchair", "stroller")]
HARDER: Mapping[str, list[str]] = {
    "plain": [],
    "four": ["world_simulator.pedestrians=4", "ads_test.perception=true"],
    "kinds": _KINDS,
    "hidden": ["world_simulator.scenarios=[104]", "ads_test.perception=true", "perception.least_visible=0.25"],
}
"""What is added to the exam, by the name of the condition."""


def examined(out: Path, system: str, condition: str, episodes: int) -> pl.DataFrame:
    """Return the episodes of one exam, which is conducted unless it has been."""
    folder = out / condition / system
    if (folder / "report.html").is_file():  # which is written last
        return pl.read_parquet(folder / EPISODES)
    changes = ["world_simulator.scenarios=[1,101,104]", *HARDER[condition]]
    sections = read_sections(params_path("ads_test"), changes)
    count = len(sections.values["world_simulator"]["scenarios"])
    sections = sections.changed("world_simulator", {"episodes": episodes // count, "episode_time": 12.0})
    sections = sections.changed("ads_test", {"pedestrians": list(PEDESTRIANS)})
    run_exam(prepare(sections, ads_class=SYSTEMS[system][1]), folder)
    return pl.read_parquet(folder / EPISODES)


def rows_of(tables: Mapping[str, pl.DataFrame], pedestrian: str) -> dict[str, pl.DataFrame]:
    """Return system -> its episodes with a pedestrian; the autopilot's are those of the exam with most of them."""
    longest = max(tables.values(), key=len)
    found = {SYSTEMS[name][0]: table.filter(driver=ADS) for name, table in tables.items()}
    found[AUTOPILOT] = longest.filter(driver=BASELINE)
    return {name: table.filter(pedestrian=pedestrian) for name, table in found.items()}


def _cell(found: Any, unit: str, sign: str = "") -> str:
    value, low, high = (found[name] for name in ("value", "low", "high"))
    if value is None:
        return "-"
    if unit:
        return f"{value:{sign}.2f} [{low:.2f}, {high:.2f}]"
    return f"{100 * value:{sign}.1f}{'' if sign else '%'} [{100 * low:.1f}, {100 * high:.1f}]"


def shares(tables: Mapping[str, pl.DataFrame], *, by_hidden: bool = False) -> Iterator[str]:
    """Yield the rows of a table of measures; by who was hidden as it became critical, of critical episodes."""
    yield (
        "| system | pedestrian |"
        + (" |" if by_hidden else "")
        + " episodes | collisions | vehicle moving | conflicts | hard braking | time lost [s] |"
    )
    yield "|---" * (8 + by_hidden) + "|"
    for pedestrian in PEDESTRIANS:
        for system, rows in rows_of(tables, pedestrian).items():
            critical = rows.filter("critical")
            for part, text in (
                ((critical.filter(~pl.col("hidden")), " in sight |"), (critical.filter("hidden"), " hidden |"))
                if by_hidden else ((rows, ""),)
            ):  # fmt: skip
                found = [estimate(part, MEASURES[name]) for name in SHOWN]
                cells = (_cell(each._asdict(), MEASURES[name].unit) for name, each in zip(SHOWN, found, strict=True))
                yield (
                    f"| {system} | {title_of(pedestrian).split(',')[0]} |{text} {part.height} | "
                    + " | ".join(cells)
                    + " |"
                )


def paired(tables: Mapping[str, pl.DataFrame]) -> Iterator[str]:
    """Yield the rows of a table of differences on the same episodes; bold where the interval leaves out 0."""
    yield (
        "| first less second | pedestrian | pairs | " + " | ".join(MEASURES[name].title for name in DIFFERENCES) + " |"
    )
    yield "|---" * (3 + len(DIFFERENCES)) + "|"
    for pedestrian in PEDESTRIANS:
        for (one, first), (two, second) in combinations(rows_of(tables, pedestrian).items(), 2):
            found, cells = differences(first, second), []
            for name in DIFFERENCES:
                text = _cell(found[name], MEASURES[name].unit, "+")
                sure = found[name]["value"] is not None and (found[name]["low"] > 0.0 or found[name]["high"] < 0.0)
                cells.append(f"**{text}**" if sure else text)
            pairs = first.join(second, on=["scenario", "episode"], how="semi").height
            yield f"| {one} less {two} | {title_of(pedestrian).split(',')[0]} | {pairs} | " + " | ".join(cells) + " |"


def main() -> None:
    """Conduct what is missing, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--episodes", type=int, default=1002, help="of each cell, in all scenarios together")
    parser.add_argument("--planner-episodes", type=int, help="of the motion planner, which takes 0.3 CPU s each")
    parser.add_argument("--systems", nargs="+", default=list(SYSTEMS), choices=list(SYSTEMS))
    parser.add_argument("--harder", nargs="+", default=list(HARDER), choices=list(HARDER), metavar="CONDITION")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    weights = given.out / "policy.safetensors"
    if "trained" in given.systems and not weights.is_file():
        program = [sys.executable, str(EXAMPLES / "trained_policy.py"), "train", str(weights)]
        subprocess.run([*program, "--steps", "60000", "--pedestrian", "autopilot"], check=True)
    os.environ["TRAINED_POLICY"] = str(weights)
    sys.path.insert(0, str(EXAMPLES))
    lines: list[str] = []
    for condition in given.harder:
        counts = dict.fromkeys(given.systems, given.episodes)
        if "planner" in counts and given.planner_episodes:
            counts["planner"] = given.planner_episodes
        tables = {name: examined(given.out, name, condition, count) for name, count in counts.items()}
        lines += [f"## {condition}", "", *shares(tables), "", *paired(tables), ""]
        if condition == "plain":
            lines += [*shares(tables, by_hidden=True), ""]
        (given.out / "tables.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
