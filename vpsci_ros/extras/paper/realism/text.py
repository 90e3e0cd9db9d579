"""The measures of realism as text: two tables of Protocol A (same start), and one of Protocol B (free simulation)."""

from typing import Any

from rich.console import Console

from vpsci_ros.evaluation.error_table import share_text
from vpsci_ros.runs.text_table import text_table


def print_realism(result: dict[str, Any], console: Console) -> None:
    """Print what `run.measure_realism` returned."""
    _same_start(result["same_start"], console)
    if "free" in result:
        _free(result["free"], console)


def _same_start(part: dict[str, Any], console: Console) -> None:
    title = f"Same start: {part['interactions']} recorded onsets of {part['clips']} clips, 3 s"
    heads = [
        "",
        "K",
        "energy\nscore [m]",
        "of constant\nvelocity's",
        "known\nlate",
        "of the\nsampler's",
        "ADE, of\nfading's",
        "likelihood",
        "C2ST AUC",
        "contact",
    ]
    rows, families = [], []
    for name, own in part["models"].items():
        auc = share_text(own["c2st_auc"], own["c2st_auc_interval"])
        rows.append(
            (
                *(name, f"{own['roll_outs']}", f"{own['energy_score']:.3f}"),
                share_text(own["of_constant_velocity"], own["of_constant_velocity_interval"]),
                f"{own['late']['of_constant_velocity']:.2f}" if "late" in own else "",
                *(f"{own['of_residual_sampler']:.2f}", f"{own['ade_of_fading_acceleration']:.2f}"),
                *(f"{own['likelihood']:.3f}", auc),
                f"{own['collision_rate']:.1%}",
            )
        )
        cells = [f"{own['c2st_auc_of'][key][0]:.2f}" for key in ("vehicle", "pedestrian", "joint")]
        families.append((name, *cells, f"{own['picked']:.0%}", _farthest(own["given_away_by"], 1)))
    console.print(text_table(title, heads, rows))
    heads = ["", "vehicle", "pedestrian", "joint", "picked", "single feature farthest from 0.5"]
    console.print(text_table("Features by which the classifier separates them", heads, families))
    for name, own in part.get("range", {}).items():
        acting = ", ".join(f"{who} at {count}" for who, count in own["people"].items())
        share = own["beyond"] / own["of"]
        console.print(
            f"{name}: reactions of {acting} onsets; {own['beyond']} of {own['of']} onsets ({share:.0%}) lie beyond the "
            "range of their recordings",
            highlight=False,
        )
    if part["not_in_library"]:
        console.print(
            f"The library holds nobody of {', '.join(part['not_in_library'])}: residual_sampler and constant_turn "
            "borrow from people of another site; noise comes from the scored clips.",
            style="bold",
        )
    units = part.get("units", f"{part['clips']} clips")  # a run of an earlier version has none
    console.print(
        "Energy score: proper, best for the true distribution; the ADE for one roll-out. Known late: accelerations "
        "before the onset are those of a sensor, the mean of 0.4 s that ended 0.2 s before. Sampler: residuals of "
        "other clips about the fading acceleration. C2ST: area under the curve of "
        f"a classifier in folds by {units.split()[1].removesuffix('s')}, mean of six, 0.5 is perfect; "
        f"recorded: recordings with another's shake. Intervals: 95%, {units} resampled.",
        highlight=False,
    )


def _farthest(given_away_by: dict[str, float], count: int) -> str:
    return ", ".join(f"{key} {value:.2f}" for key, value in list(given_away_by.items())[:count])


def _free(part: dict[str, Any], console: Console) -> None:
    whole = part["long_run"]
    rows = [
        (key.replace("_", " "), *("{:.2f} [{:.2f}, {:.2f}]".format(*own[key]) for own in whole.values()))
        for key in next(iter(whole.values()))
    ]
    console.print(text_table("Free simulation in the long run, watched equally long", ("", *whole), rows))
    console.print(
        f"Intervals: 95%, {part.get('units', 'clips')} of recordings and single generated episodes resampled.",
        highlight=False,
    )
    for name, (auc, low, high) in part["c2st_auc"].items():
        single = _farthest(part["given_away_by"][name], 3)
        console.print(f"C2ST, {name}: {auc:.2f} ({low:.2f}-{high:.2f}); {single}", highlight=False)
