"""The measures of realism as text: one table a protocol, in 100 columns."""

from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table


def print_realism(result: dict[str, Any], console: Console) -> None:
    """Print what `run.measure_realism` returned."""
    _same_start(result["same_start"], console)
    for source, part in result["same_start"].get("by_source", {}).items():
        _same_start(part, console, f" of {source}")
    if "free" in result:
        _free(result["free"], console)
    if "elsewhere" in result:
        _elsewhere(result["elsewhere"], console)


def _same_start(part: dict[str, Any], console: Console, of: str = "") -> None:
    title = f"Same start: {part['interactions']} recorded onsets of {part['clips']} clips{of}, 3 s"
    view = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", padding=(0, 1, 0, 0))
    view.add_column("")
    heads = (
        "K",
        "energy\nscore [m]",
        "of constant\nvelocity's",
        "of mean\nturn's",
        "likelihood",
        "C2ST AUC",
        "contact",
    )
    for head in heads:
        view.add_column(head, justify="right", no_wrap=True)
    for name, own in part["models"].items():
        low, high = own["of_constant_velocity_interval"]
        first, last = own["c2st_auc_interval"]
        view.add_row(
            name,
            str(own["roll_outs"]),
            f"{own['energy_score']:.3f}",
            f"{own['of_constant_velocity']:.2f} ({low:.2f}-{high:.2f})",
            f"{own['of_constant_turn']:.2f}",
            f"{own['likelihood']:.3f}",
            f"{own['c2st_auc']:.2f} ({first:.2f}-{last:.2f}) ±{own['c2st_auc_spread']:.2f}",
            f"{own['collision_rate']:.1%}",
        )
    console.print(view)
    families = Table(box=box.SIMPLE_HEAD, title="What tells them apart", title_justify="left", padding=(0, 1, 0, 0))
    families.add_column("")
    for head in ("vehicle", "pedestrian", "joint", "picked"):
        families.add_column(head, justify="right")
    families.add_column("single features farthest from 0.5")
    for name, own in part["models"].items():
        cells = [f"{own['c2st_auc_of'][key][0]:.2f}" for key in ("vehicle", "pedestrian", "joint")]
        single = ", ".join(f"{key} {value:.2f}" for key, value in list(own["given_away_by"].items())[:3])
        families.add_row(name, *cells, f"{own['picked']:.0%}", single)
    console.print(families)
    if part["not_in_library"]:
        console.print(
            f"The library holds nobody of {', '.join(part['not_in_library'])}: residual_sampler and constant_turn "
            "borrow from people of another site; noise comes from the scored clips.",
            style="bold",
        )
    console.print(
        "Energy score: proper, best for the true distribution; the ADE for one roll-out. C2ST: area under the curve of "
        "a classifier in folds by clip, mean of ten ± deviation, 0.5 is perfect; recorded: recordings with another's "
        "shake. Intervals: 95%, by clips.",
        highlight=False,
    )


def _free(part: dict[str, Any], console: Console) -> None:
    view = Table(box=box.SIMPLE_HEAD, title="Free simulation, critical episodes", title_justify="left")
    view.add_column("")
    sides = list(part["described"])
    for name in sides:
        view.add_column(name, justify="right")
    for key in part["described"][sides[0]]:
        view.add_row(key.replace("_", " "), *(f"{part['described'][name][key]:.2f}" for name in sides))
    console.print(view)
    for name, (auc, low, high) in part["c2st_auc"].items():
        single = ", ".join(f"{key} {value:.2f}" for key, value in list(part["given_away_by"][name].items())[:3])
        console.print(f"C2ST, {name}: {auc:.2f} ({low:.2f}-{high:.2f}); {single}", highlight=False)


def _elsewhere(part: dict[str, Any], console: Console) -> None:
    for limit, sides in part.items():
        title = f"Right turns elsewhere, {limit.replace('_', ' ')} of encroachment time"
        view = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left")
        view.add_column("")
        known = {name.replace("_", " "): own for name, own in sides.items() if own["conflicts"]}
        for name, own in known.items():
            view.add_column(f"{name}\nn={own['conflicts']}", justify="right")
        for agent in ("driver", "pedestrian"):
            for key in next(iter(known.values()))[agent]:
                view.add_row(f"{agent} {key}", *(f"{own[agent][key]:.0%}" for own in known.values()))
        view.add_row("pedestrian first", *(f"{own['pedestrian_first']:.0%}" for own in known.values()))
        console.print(view)
