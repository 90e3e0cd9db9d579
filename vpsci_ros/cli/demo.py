"""The demonstration: near misses in, all three stages through the graph of nodes, small, a page that shows them out."""

import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput, VpsciError, require
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.resources import TO_LEARN_FROM, near_misses_path, params_dir
from vpsci_ros.runs.files import is_empty_folder
from vpsci_ros.runs.sections import Sections
from vpsci_ros.view.page import write_view
from vpsci_ros.view.sources import Shown, Source, read_source, shown

PAGE = "demo.html"
MARKER = ".vpsci_demo"  # in an output folder that a later demo may replace
PATIENCE = 30.0  # [s] for an answer, on whatever machine and beside whatever else
SMALL: dict[str, dict[str, dict[str, Any]]] = {
    "stage1_pretrain.yaml": {
        "learner": {
            "episodes": 100,
            "evaluate_every": 50,
            "hidden": 64,
            "layers": 1,
            "heads": 4,
            "key_dimension": 16,
            "updates.actor_learning_rate": 1e-3,
            "updates.critic_learning_rate": 1e-3,
        }
    },
    "stage2_online.yaml": {
        "world_simulator": {"episodes": 6, "batch": 16, "replay_window": 128, "action_timeout": PATIENCE},
        "learner": {
            "replay.batch_size": 64,
            "refresh.updates": 5,
        },
    },
    "stage3_generate.yaml": {"world_simulator": {"episodes": 24, "batch": 32, "action_timeout": PATIENCE}},
}


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
    from vpsci_ros.nodes.graph import run_graph

    console = Console()
    _make_room(folder, force)
    console.print("three small stages, then a page")
    begun = time.monotonic()
    near_misses = _near_misses(folder, data, console)
    with own_domain():
        learned = ""
        for stage, (name, small) in enumerate(SMALL.items(), start=1):
            sections = load(params_dir() / name)
            for node, values in small.items():
                sections = sections.changed(node, values)
            if stage < 3:
                sections = sections.changed("learner", {"near_misses": [str(near_misses)]})
            if stage == 2:
                sections = sections.changed("learner", {"weights": learned})
            if stage == 3:
                for node in ("vehicle_policy", "pedestrian_policy"):
                    sections = sections.changed(node, {"weights": learned})
            title = ("learn from near misses", "learn on in simulation", "generate interactions")[stage - 1]
            console.rule(f"stage {stage}: {title}", align="left")
            result = run_graph(sections, folder / f"stage{stage}")
            if result.error:
                raise VpsciError(f"stage {stage}: {result.error}")
            if stage < 3:
                learned = str(result.folder / "learner" / ("pretrained.safetensors", "refined.safetensors")[stage - 1])
            console.print(f"{_outcome(stage, result.nodes.get('learner'))}done in {result.wall_time:.0f} s")
    export_bag(folder / "stage3" / "bag", folder / "dataset", console=console)
    console.rule("the same episodes by the shipped weights, which have learned for longer", align="left")
    write_view(folder / PAGE, demo_sources(folder, sections, near_misses), "vpsci demo")
    console.print(f"all in {time.monotonic() - begun:.0f} s; written:")
    for name in ("near_misses.parquet", learned, "stage2/bag", "stage3/bag", "dataset"):
        console.print(f"  {Path(name) if name == learned else folder / name}")
    console.print(
        f"\nnow open this in a browser: [bold]{(folder / PAGE).resolve()}[/]\n"
        "episodes of the shipped weights beside the same ones by those that have just learned for a minute, and the "
        "near misses",
        soft_wrap=True,
    )


def demo_sources(folder: Path, sections: Sections, near_misses: Path) -> list[Source]:
    """Return what the demo's page shows: shipped weights, those just trained on the same episodes, and near misses.

    :param sections: of stage 3, with the weights that were just trained.
    """
    from vpsci_ros.data.gathered import gathered
    from vpsci_ros.policy.agent import policies
    from vpsci_ros.policy.policy_file import load_policy
    from vpsci_ros.policy.simulation import simulation_of
    from vpsci_ros.world.loop import Loop

    simulation = simulation_of(sections)
    world = simulation.make_world()
    agents = policies(load_policy("people"), world, simulation.policies)
    steps = Loop(world, simulation.monitor, agents)
    period = simulation.world.tick
    ticks = ((step.tick.state, step.assessment.curvttc, step.assessment.distance) for step in steps)
    own = sorted(map(shown, gathered(ticks, period, simulation.scenarios)), key=_key)
    trained = read_source(folder / "stage3" / "bag")
    return [
        Source("shipped", "shipped weights", period, own, len(own)),
        replace(trained, key="trained", title="learned for a minute", episodes=sorted(trained.episodes, key=_key)),
        replace(read_source(near_misses), key="near_misses", title="near misses"),
    ]


def _key(each: Shown) -> tuple[int, int]:
    return each.episode.key


def _outcome(stage: int, learner: NodeStatus | None) -> str:
    """Return what a stage of learning came to: errors on clips that it never learned from, beside the control's."""
    seen = learner.figures if learner else {}
    if stage == 1 and "closed_loop_ade" in seen:
        return (
            f"closed-loop error (ADE) on held-out clips: {float(seen['closed_loop_ade']):.3f} m, "
            f"of the last velocity repeated: {float(seen['control_closed_loop_ade']):.3f} m\n"
        )
    if stage == 2 and "updates" in seen:
        count = {name: round(float(seen[name])) for name in ("transitions", "lost", "updates", "refreshes")}
        return (
            f"{count['transitions']} transitions ({count['lost']} lost), {count['updates']} updates, "
            f"{count['refreshes']} refreshes of the policies\n"
        )
    return ""


def _make_room(folder: Path, force: bool) -> None:
    if folder.is_dir() and not is_empty_folder(folder):
        if not (folder / MARKER).exists():
            raise InvalidInput(f"{folder}: not empty, and not an earlier demo's; choose another folder with -o")
        if not force:
            raise InvalidInput(f"{folder}: holds an earlier demo; add --force to replace it, or choose another with -o")
        for inside in folder.iterdir():
            if inside.is_dir() and not inside.is_symlink():
                shutil.rmtree(inside)
            else:
                inside.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARKER).write_text("made by 'vpsci demo', which may replace this folder\n", encoding="utf-8")


def _near_misses(folder: Path, data: Path | None, console: Console) -> Path:
    from vpsci_ros.data.importers import import_folders, print_import_summary
    from vpsci_ros.data.near_misses import concat_near_misses, read_near_misses, write_near_misses
    from vpsci_ros.data.parquet import read_metadata

    console.rule("near misses", align="left")
    tables, shipped = [read_near_misses(TO_LEARN_FROM)], near_misses_path(TO_LEARN_FROM)
    sources = read_metadata(shipped)["sources"]
    console.print(
        f"{tables[0]['interaction'].n_unique()} of cars that turn right and people who cross, recorded at two corners "
        f"in Chongqing; whose they are: {shipped.parent / 'README.md'}",
        soft_wrap=True,
    )
    if data is not None:
        if not data.is_dir():
            raise InvalidInput(f"{data}: no such folder; expected one that holds vci_dut and vci_citr")
        campus = import_folders([data / "vci_dut", data / "vci_citr"], ["vci-dut", "vci-citr"])
        print_import_summary(campus, console)
        tables, sources = [*tables, campus.table], sources | campus.metadata["sources"]
    path = folder / "near_misses.parquet"
    write_near_misses(concat_near_misses(tables), path, {"sources": sources})
    return path
