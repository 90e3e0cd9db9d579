"""The measures of realism as text: two tables of Protocol A (same start), and one of Protocol B (free simulation)."""

from collections.abc import Sequence
from typing import Any

from rich.console import Console

from vpsci_ros.evaluation.error_table import share_text
from vpsci_ros.extras.paper.realism.beside_sampler import VIEWS
from vpsci_ros.extras.paper.realism.controls import CONTROLS, FORCE, SAMPLER
from vpsci_ros.extras.paper.realism.in_front import COMPARED, EXCHANGES
from vpsci_ros.runs.text_table import text_table

TITLES = (
    "Both agents act",
    "The pedestrian acts in front of the recorded car; energy score of the pedestrian",
    "The vehicle acts in front of the recorded pedestrian; energy score of the vehicle",
)
SCORED = ("energy", "brier", "crps")


def print_realism(result: dict[str, Any], console: Console) -> None:
    """Print what `run.measure_realism` returned."""
    _same_start(result["same_start"], console)
    if "forecasts" in result["same_start"]:  # a run of an earlier version has none
        _beside_sampler(result["same_start"], console)
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
        share, unknown = own["beyond"] / own["of"], own.get("unknown_accelerations", 0)
        console.print(
            f"{name}: reactions of {acting} onsets; {own['beyond']} of {own['of']} onsets ({share:.0%}) lie beyond the "
            "range of their recordings"
            + (f"; {unknown} of {own['situations']} situations lack an acceleration before them" if unknown else ""),
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


def _beside_sampler(part: dict[str, Any], console: Console) -> None:
    for view, title in zip(VIEWS, TITLES, strict=True):
        heads = ["", "energy,\nof CV's", "less the\nsampler's", "Brier", "less the\nsampler's", "CRPS [m]"]
        heads += ["less the\nsampler's", "contact"]
        rows: list[Sequence[str] | None] = []
        for name, own in part["models"].items():
            cells = [cell for key in SCORED for cell in _score(own[view], key)]
            rows.append((name, *cells, f"{own[view]['contact'][0]:.1%}"))
        rows.append(None)
        rows += [(name, "", "", *_score(own[view], "brier"), "", "", "") for name, own in part["forecasts"].items()]
        console.print(text_table(title, heads, rows))
    heads = [
        "",
        *(f"{who if key == 'energy' else ''}\n{key}" for who in ("both:", "pedestrian:", "vehicle:") for key in SCORED),
    ]
    rows = [
        (name, *(f"{own['late'][view][key][0]:.3f}" for view in VIEWS for key in SCORED))
        for name, own in part["models"].items()
    ]
    console.print(text_table("The same, accelerations known late", heads, rows))
    for agent, other in (("pedestrian", "car"), ("vehicle", "pedestrian")):
        _answers(part, agent, other, console)
    counts = part["counts"]
    text = (
        f"Of {counts['recordings']} recordings {counts['never_critical']} were never critical by what was known then, "
        f"and {counts['end_within_3s']} end within 3 s of the onset: left out. Of {part['interactions']} onsets "
        f"{counts['without_step_before']} have no step before (known late: {counts['without_late']}), so that "
        f"accelerations count as 0, and {counts['open']} leave open who goes first: no Brier score. Brier: share of "
        "roll-outs in which the pedestrian goes first, against the whole recorded track. CRPS: of the least clearance. "
        "Recorded answers are sorted by what the other one did: no experiment, since drivers brake "
        "for pedestrians who walk on."
    )
    for name, own in part["models"].items():
        if name not in CONTROLS:
            mean, most = own["pedestrian"]["off"]
            text += f" {name} sees the recorded car {mean:.2f} m off its recording in the mean, at most {most:.2f} m."
    console.print(text, highlight=False)


def _answers(part: dict[str, Any], agent: str, other: str, console: Console) -> None:
    first, second = (name.replace("_", " ") for name in COMPARED[agent])
    title = f"Speed of the {agent} 3 s after the onset, where the {other} does the same at every onset: share slower "
    title += f"by a fifth, change [m/s]; difference: {first} less {second}"
    heads = [
        "",
        *(name.replace("_", "\n") for name in EXCHANGES[agent]),
        "difference:\nslower [points]",
        "\nchange [m/s]",
    ]
    heads += ["known late:\nslower", "\nchange"]
    rows = []
    for name, own in part["models"].items():
        if name not in CONTROLS or name in (FORCE, SAMPLER):
            late = own["late"]["answers"][agent]["difference"]
            more = f"{100.0 * late['slower'][0]:+.0f}", f"{late['change'][0]:+.2f}"
            rows.append((name, *_answer_cells(own["answers"][agent], agent), *more))
    recorded = part["recorded_answers"][agent]
    rows.append(("recorded, sorted", *_answer_cells(recorded, agent), "", ""))
    rows.append(("  onsets", *(f"{recorded[name]['n']}" for name in EXCHANGES[agent]), "", "", "", ""))
    console.print(text_table(title, heads, rows))


def _answer_cells(own: dict[str, Any], agent: str) -> list[str]:
    cells = [f"{own[name]['slower'][0]:.0%} {own[name]['change'][0]:+.2f}" for name in EXCHANGES[agent]]
    slower, change = ([own["difference"][key][i] for i in range(3)] for key in ("slower", "change"))
    cells.append("{:+.0f} ({:+.0f}, {:+.0f})".format(*(100.0 * value for value in slower)))
    return [*cells, "{:+.2f} ({:+.2f}, {:+.2f})".format(*change)]


def _score(scores: dict[str, list[float]], key: str) -> tuple[str, str]:
    """Return a score and its difference to the sampler's with the interval, as text."""
    return f"{scores[key][0]:.3f}", "{:+.2f} ({:+.2f}, {:+.2f})".format(*scores[f"{key}_minus_sampler"])


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
