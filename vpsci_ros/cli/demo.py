"""The demonstration: an import, two short trainings, a generation by nodes, and a page that plays episodes."""

import os
import shutil
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import polars as pl
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput, VpsciError, require
from vpsci_ros.resources import TO_LEARN_FROM, near_misses_path, params_dir
from vpsci_ros.runs.files import is_empty_folder, require_empty_folder
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.view.episode_sources import read_source
from vpsci_ros.view.view_page import Shown, Source, shown, write_view

PAGE = "demo.html"
_MADE = (PAGE, "near_misses.parquet", "dataset", "stage1", "stage2", "stage3")
PATIENCE = 30.0  # [s] for an answer, on whatever machine and beside whatever else
SMALL: dict[str, dict[str, dict[str, Any]]] = {
    "stage1_pretrain.yaml": {
        "learner": {
            "episodes": 100,
            "hidden": 64,
            "layers": 1,
            "updates.actor_learning_rate": 1e-3,
            "updates.critic_learning_rate": 1e-3,
        }
    },
    "stage2_online.yaml": {
        "world_simulator": {"episodes": 4, "batch": 16, "action_timeout": PATIENCE},
        "learner": {"replay.batch_size": 64, "refresh_every": 5},
    },
    "stage3_generate.yaml": {"world_simulator": {"episodes": 24, "batch": 32, "action_timeout": PATIENCE}},
}


TITLES = ("recordings", "learn from them", "learn on in simulation", "generate", "compare")


def run_demo(folder: Path, data: Path | None, *, force: bool = False) -> None:
    """Run the demonstration into `folder`.

    :param data: folder that holds vci_dut and vci_citr, to be learned from besides the package's right turns.
    :param force: replace what an earlier demo left there.
    :raises InvalidInput: the folder holds something else, or `data` does not hold recordings.
    :raises VpsciError: a stage failed.
    """
    require("torch", "rclpy")
    from vpsci_ros.bags.export import export_bag
    from vpsci_ros.nodes.domain import own_domain

    console = Console(highlight=False)
    _make_room(folder, force)
    begun = time.monotonic()
    _begin(console, 1)
    near_misses = _near_misses(folder, data, console)
    with own_domain():
        _begin(console, 2)
        corpus = {"near_misses": [str(near_misses)]}
        figures, learned, _ = _stage(folder, 1, {"learner": corpus})
        _say(
            console,
            f"{SMALL['stage1_pretrain.yaml']['learner']['episodes']} episodes",
            f"error {_figure(figures, 'closed_loop_ade', ' m')}",
            f"of a control {_figure(figures, 'control_closed_loop_ade', ' m')}",
            "The paper's networks imitated recorded people for a minute. The error is their mean distance to people on "
            "clips that they never saw; the control repeats the last velocity.",
        )
        _begin(console, 3)
        figures, learned, _ = _stage(folder, 2, {"learner": corpus | {"weights": learned}})
        _say(
            console,
            f"{_figure(figures, 'transitions')} transitions",
            f"{_figure(figures, 'updates')} updates",
            f"{_figure(figures, 'refreshes')} refreshes",
            "The same networks learned from what happened to them in simulated episodes; a refresh sends new weights "
            "to the running policies.",
        )
        _begin(console, 4)
        _, _, sections = _stage(folder, 3, {})
    description = export_bag(folder / "stage3" / "bag", folder / "dataset", console=Console(quiet=True))
    sources = demo_sources(folder, sections, near_misses, learned)
    people, trained = sources[0].episodes, sources[1].episodes
    _say(
        console,
        f"{len(people)} episodes",
        f"{sum(one.episode.least_curvttc < CRITICAL_TTC for one in people)} critical",
        f"{sum(row['kept'] for row in description['scenarios'].values())} kept",
        "The default agents, `people`, acted: they replay recorded reactions, chosen so that nobody is touched. "
        "The dataset keeps critical episodes without faults.",
    )
    _begin(console, 5)
    console.print(_beside(people, trained))
    console.print("Both drove the same episodes. A minute of learning is too short; reactions of people need none.")
    write_view(folder / PAGE, sources, "vpsci demo")
    python = min(sys.executable, os.path.relpath(sys.executable), key=len)
    vpsci = "vpsci" if shutil.which("vpsci") else str(Path(python).parent / "vpsci")
    example = "--ads-class vpsci_ros.nodes.example_driver:ExampleDriver"
    console.print(
        f"\ndone in {time.monotonic() - begun:.0f} s; bags, tables and weights are in {escape(str(folder))}\n\n"
        f"[bold]watch it[/]    {python} -m webbrowser {(folder / PAGE).resolve().as_uri()}\n\n"
        "[bold]go on[/]\n"
        f"  {vpsci} generate -o out/dataset --episodes 100    # a dataset\n"
        f"  {vpsci} ads-test -o out/exam --episodes 5 {example}    # an exam\n"
        f"  {vpsci} bag info {escape(str(folder / 'stage3' / 'bag'))}    # what the nodes published",
        soft_wrap=True,
    )


def _begin(console: Console, number: int) -> None:
    console.rule(f"{number} of {len(TITLES)}: {TITLES[number - 1]}", align="left")


def _say(console: Console, *told: str) -> None:
    """Print three numbers of a stage, and in words what they mean."""
    console.print(f"[bold]{'  |  '.join(told[:-1])}[/]")
    console.print(told[-1])


def _figure(figures: dict[str, Any], name: str, unit: str = "") -> str:
    if name not in figures:
        return "unknown"
    return f"{float(figures[name]):.2f}{unit}" if unit else f"{round(float(figures[name])):,}"


def _stage(folder: Path, stage: int, changes: dict[str, dict[str, Any]]) -> tuple[dict[str, Any], str, Sections]:
    """Run a stage through its nodes; return the learner's figures, the weights it left, and the parameters.

    The nodes share a process, since a start of six takes longer on two cores than what they do here.

    :raises VpsciError: the stage failed.
    :raises KeyboardInterrupt: stopped on request.
    """
    from vpsci_ros.nodes.graph import STOPPED, run_graph

    name = list(SMALL)[stage - 1]
    sections = load(params_dir() / name).changed("graph", {"composed": True, "progress_timeout": 20 * PATIENCE})
    for node, values in (*SMALL[name].items(), *changes.items()):
        sections = sections.changed(node, values)
    result = run_graph(sections, folder / f"stage{stage}")
    if result.error == STOPPED:
        raise KeyboardInterrupt
    if result.error:
        raise VpsciError(f"stage {stage}: {result.error}")
    learner = result.nodes.get("learner")
    weights = ("pretrained.safetensors", "refined.safetensors", "")[stage - 1]
    return dict(learner.figures) if learner else {}, str(result.folder / weights), sections


def _beside(people: Sequence[Shown], trained: Sequence[Shown]) -> Table:
    """Return a table of three measures: of episodes by `people`, and of the same episodes by the trained weights."""
    table = Table("", "people", "learned for a minute", box=None, pad_edge=False)
    measures: dict[str, Callable[[Sequence[Shown]], str]] = {
        "collisions": lambda all_: _share(one.episode.outcome == "collision" for one in all_),
        "the vehicle yields": lambda all_: _share("vehicle_yields" in one.marks for one in all_),
        "least CurvTTC, median": lambda all_: f"{statistics.median(one.episode.least_curvttc for one in all_):.1f} s",
    }
    for name, measure in measures.items():
        table.add_row(name, measure(people), measure(trained))
    return table


def _share(hits: Iterable[bool]) -> str:
    found = list(hits)
    return f"{sum(found)} of {len(found)}"


def demo_sources(folder: Path, sections: Sections, near_misses: Path, learned: str) -> list[Source]:
    """Return the sources of the demo's page: episodes by `people`, the same episodes by trained weights, near misses.

    :param sections: of stage 3.
    :param learned: file of the weights that were just trained.
    """
    from vpsci_ros.data.episode_block import ended_episodes
    from vpsci_ros.policy.agent import policies
    from vpsci_ros.policy.policy_file import load_policy
    from vpsci_ros.policy.simulation_config import simulation_of
    from vpsci_ros.world.loop import Loop

    simulation = simulation_of(sections)
    world = simulation.make_world()
    steps = Loop(world, policies(load_policy(learned), world, simulation.policies))
    period, in_turn = simulation.world.tick, attrgetter("episode.key")
    trained = sorted(map(shown, ended_episodes(steps, period, simulation.scenarios)), key=in_turn)
    people = read_source(folder / "stage3" / "bag")
    return [
        replace(people, key="people", title="generated by people", episodes=sorted(people.episodes, key=in_turn)),
        Source("trained", "learned for a minute", period, trained, len(trained)),
        replace(read_source(near_misses), key="near_misses", title="recorded near misses"),
    ]


def _make_room(folder: Path, force: bool) -> None:
    if not is_empty_folder(require_empty_folder(folder, *_MADE)) and not force:
        raise InvalidInput(f"{folder}: holds an earlier demo; add --force to replace it, or choose another with -o")
    for inside in folder.iterdir():
        if inside.is_dir() and not inside.is_symlink():
            shutil.rmtree(inside)
        else:
            inside.unlink()


def _near_misses(folder: Path, data: Path | None, console: Console) -> Path:
    from vpsci_ros.data.importers import import_folders
    from vpsci_ros.data.near_misses import concat_near_misses, read_near_misses, write_near_misses
    from vpsci_ros.data.parquet import read_metadata

    tables, shipped = [read_near_misses(TO_LEARN_FROM)], near_misses_path(TO_LEARN_FROM)
    sources = read_metadata(shipped)["sources"]
    if data is not None:
        if not data.is_dir():
            raise InvalidInput(f"{data}: no such folder; expected one that holds vci_dut and vci_citr")
        campus = import_folders([data / "vci_dut", data / "vci_citr"], ["vci-dut", "vci-citr"])
        tables, sources = [*tables, campus.table], sources | campus.metadata["sources"]
    path = folder / "near_misses.parquet"
    table = concat_near_misses(tables)
    write_near_misses(table, path, {"sources": sources})
    least = table.group_by("interaction").agg(pl.col("curvttc").min())["curvttc"].to_list()
    _say(
        console,
        f"{len(least):,} near misses",
        f"{table.select('source', 'clip').n_unique()} clips",
        f"least CurvTTC {statistics.median(least):.1f} s in the median",
        "Recorded cars and pedestrians came within 5 s of a contact, and reacted; CurvTTC is the time to it along the "
        "car's curve.",
    )
    return path
