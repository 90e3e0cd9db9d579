"""The tables of docs/driving_systems.md: four driving systems on the same episodes, and their paired differences.

    python benchmarks/driving_systems.py OUT [--episodes 1002] [--harder-episodes 150] [--conditions plain four ...]

The systems drive in this process, by `--ads-class`; the rule-based autopilot is the comparison of each exam. The
policy is trained first, in OUT, unless it is there; "trainings" are two more of it, by other seeds. Exams that are done
are not driven again. What a system sees concerns only those who look: in the conditions of perception the example and
the planner drive, and are compared with themselves in the plain exam, on the same episodes. The tables are printed as
Markdown and written to OUT/tables.md.
"""

import argparse
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from itertools import combinations, product
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.cli.options import read_sections
from vpsci_ros.exam.conduct import run_exam
from vpsci_ros.exam.exam import ADS, BASELINE, prepare, title_of
from vpsci_ros.exam.measures import EPISODES
from vpsci_ros.exam.report import differences
from vpsci_ros.exam.scores import MEASURES, estimate
from vpsci_ros.policy.policy_config import LEARNED
from vpsci_ros.resources import params_path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
SYSTEMS = {
    "example": ("`example_ads`", "vpsci_ros.nodes.example_driver:ExampleDriver"),
    "trained": ("trained policy", "trained_policy:PolicyDriver"),
    "planner": ("motion planner", "motion_planner:PlannerDriver"),
    "seed2": ("trained policy, seed 2", "trained_policy:PolicyDriver"),
    "seed3": ("trained policy, seed 3", "trained_policy:PolicyDriver"),
}
SEEDS = {"trained": 1, "seed2": 2, "seed3": 3}  # of trainings
AUTOPILOT = "rule-based autopilot"
PEDESTRIANS = (LEARNED, "walker")
SHOWN = ("collision_rate", "moving_collision_rate", "conflict_rate", "hard_braking_rate", "time_lost")
_HEADS = ("collisions", "vehicle moving", "conflicts", "hard braking", "time lost [s]")
PLAIN = "plain"
_KINDS = ("older", "child", "distracted", "wheelchair", "stroller")
_ERRORS = ("reach=40.0", "field_of_view=120.0", "position_noise=0.2", "velocity_noise=0.3", "missed=0.1",
           "latency=0.15", "lost_rate=0.1")  # fmt: skip
_SEEN = ["ads_test.perception=true", "ads_test.baseline=false", "perception.least_visible=0.25"]
ADDED: Mapping[str, list[str]] = {
    PLAIN: [],
    "trainings": ["ads_test.baseline=false"],
    "four": ["world_simulator.pedestrians=4"],
    "kinds": [f"world_simulator.kinds.{kind}=1.0" for kind in _KINDS],
    "hidden": ["world_simulator.scenarios=[104]", *_SEEN],
    "errors": [*_SEEN, *(f"perception.{error}" for error in _ERRORS)],
}
"""Condition -> what is added to the exam."""
TITLES = {"trainings": "trained by another seed", "four": "four pedestrians", "kinds": "all kinds", "hidden": "hidden",
          "errors": "all errors"}  # fmt: skip
DRIVING = {"trainings": ("seed2", "seed3"), "hidden": ("example", "planner"), "errors": ("example", "planner")}
"""Condition -> who drives in it; in the others the first three."""
OF_PERCEPTION = ("hidden", "errors")


def examined(out: Path, system: str, condition: str, episodes: int) -> pl.DataFrame:
    """Return the episodes of one exam, which is conducted unless it has been."""
    folder = out / condition / system
    if (folder / "report.html").is_file():  # which is written last
        return pl.read_parquet(folder / EPISODES)
    changes = ["world_simulator.scenarios=[1,101,104]", *ADDED[condition]]
    sections = read_sections(params_path("ads_test"), changes)
    count = len(sections.values["world_simulator"]["scenarios"])
    sections = sections.changed("world_simulator", {"episodes": episodes // count, "episode_time": 12.0})
    sections = sections.changed("ads_test", {"pedestrians": list(PEDESTRIANS)})
    if system in SEEDS:
        os.environ["TRAINED_POLICY"] = str(policy_of(out, SEEDS[system]))
    run_exam(prepare(sections, ads_class=SYSTEMS[system][1]), folder)
    return pl.read_parquet(folder / EPISODES)


def policy_of(out: Path, seed: int) -> Path:
    """Return the weights of the policy that is trained by a seed, which are learned unless they are there."""
    weights = out / f"policy_{seed}.safetensors"
    if not weights.is_file():
        program = [sys.executable, str(EXAMPLES / "trained_policy.py"), "train", str(weights), "--seed", str(seed)]
        subprocess.run([*program, "--steps", "60000", "--pedestrian", "autopilot"], check=True)
    return weights


def rows_of(tables: Mapping[str, pl.DataFrame], pedestrian: str) -> dict[str, pl.DataFrame]:
    """Return system -> its episodes with a pedestrian; the autopilot, where it drove, comes last."""
    found = {SYSTEMS[name][0]: table.filter(driver=ADS) for name, table in tables.items()}
    autopilot = next(iter(tables.values())).filter(driver=BASELINE)
    found |= {AUTOPILOT: autopilot} if autopilot.height else {}
    return {name: table.filter(pedestrian=pedestrian) for name, table in found.items()}


def _cell(found: Any, unit: str, sign: str = "") -> str:
    value, low, high = (found[name] for name in ("value", "low", "high"))
    if value is None or math.isnan(value):
        return "-"
    if unit:
        return f"{value:{sign}.2f} [{low:.2f}, {high:.2f}]"
    return f"{100 * value:{sign}.1f}{'' if sign else '%'} [{100 * low:.1f}, {100 * high:.1f}]"


def shares(tables: Mapping[str, pl.DataFrame], condition: str = "") -> Iterator[str]:
    """Yield the rows of a table of measures, with the condition in front unless it is empty."""
    for pedestrian in PEDESTRIANS:
        for system, rows in rows_of(tables, pedestrian).items():
            cells = (_cell(estimate(rows, MEASURES[name])._asdict(), MEASURES[name].unit) for name in SHOWN)
            yield row(condition, system, _short(pedestrian), rows.height, *cells)


def paired(first: pl.DataFrame, second: pl.DataFrame) -> tuple[str, ...]:
    """Return how many episodes two systems share, and the differences on these; bold where the interval leaves out 0.

    :raises SystemExit: an episode of the first is none of the second.
    """
    pairs = first.join(second, on=["scenario", "episode"], how="semi").height
    if pairs != first.height:
        raise SystemExit(f"{first.height - pairs} of {first.height} episodes have no counterpart")
    found, cells = differences(first, second), []
    for name in SHOWN:
        text = _cell(found[name], MEASURES[name].unit, "+")
        sure = found[name]["value"] is not None and (found[name]["low"] > 0.0 or found[name]["high"] < 0.0)
        cells.append(f"**{text}**" if sure else text)
    return str(pairs), *cells


def row(*cells: object) -> str:
    """Return a row of a Markdown table; empty cells are left out."""
    return f"| {' | '.join(str(cell) for cell in cells if cell != '')} |"


def head(*cells: str) -> list[str]:
    """Return the head of a table whose last columns are the measures."""
    return ["", row(*cells, *_HEADS), "|---" * (len(cells) + len(_HEADS)) + "|"]


def _short(pedestrian: str) -> str:
    return title_of(pedestrian).split(",")[0].removesuffix(" pedestrian")


def report(found: Mapping[str, Mapping[str, pl.DataFrame]]) -> Iterator[str]:
    """Yield the lines of all tables, of condition -> system -> its episodes."""
    if plain := found.get(PLAIN):
        yield from [*head("system", "pedestrian", "episodes"), *shares(plain)]
        yield from head("first less second", "pedestrian", "pairs")
        for pedestrian in PEDESTRIANS:
            for (one, first), (two, second) in combinations(rows_of(plain, pedestrian).items(), 2):
                yield row(f"{one} less {two}", _short(pedestrian), *paired(first, second))
    if harder := [condition for condition in TITLES if condition in found]:
        yield from head("condition", "system", "pedestrian", "episodes")
    for condition in harder:
        yield from shares(found[condition], TITLES[condition])
    compared = [condition for condition in harder if plain and condition in OF_PERCEPTION]
    if compared:
        yield from head("condition less plain", "system", "pedestrian", "pairs")
    for condition, pedestrian in product(compared, PEDESTRIANS):
        for system, rows in rows_of(found[condition], pedestrian).items():
            without = rows_of(found[PLAIN], pedestrian)[system]
            yield row(TITLES[condition], system, _short(pedestrian), *paired(rows, without))


def main() -> None:
    """Conduct what is missing, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--episodes", type=int, default=1002, help="of each cell, in all scenarios together")
    parser.add_argument("--harder-episodes", type=int, default=150, help="likewise, in the other conditions")
    parser.add_argument("--conditions", nargs="+", default=list(ADDED), choices=list(ADDED), metavar="CONDITION")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    sys.path.insert(0, str(EXAMPLES))
    found: dict[str, dict[str, pl.DataFrame]] = {}
    for condition in given.conditions:
        count = given.episodes if condition == PLAIN else given.harder_episodes
        systems = DRIVING.get(condition, ("example", "trained", "planner"))
        found[condition] = {name: examined(given.out, name, condition, count) for name in systems}
    text = "\n".join(report(found)).strip() + "\n"
    (given.out / "tables.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
