"""Table 9 as a page in Markdown: all columns, the main ones with intervals, for reports and docs/results."""

from collections.abc import Sequence
from typing import Any

from vpsci_ros.extras.paper.published import TABLE_9
from vpsci_ros.extras.paper.section_4.table import markdown

PAGE = "models.md"
_CONTROLS = {
    "repeat_velocity": "last velocity repeated",
    "constant_velocity_tracked": "constant velocity, tracked",
    "fading_acceleration": "last acceleration repeated; in closed loop fading",
}


def table_9_page(result: dict[str, Any]) -> str:
    """Return the result of `model_comparison.compare_models` as Markdown; `+` in a name means hybrid learning.

    Errors [m, m/s] by both protocols with the paper's ADE on its own data; where they were measured, likeness to
    people, outcomes in simulation and cost.
    """
    models = {_title(name): (name, of) for name, of in result["models"].items() if name != "constant_velocity"}
    extent = (
        f"{result['interactions']} interactions of {result['clips']} clips, each held out once; {result['folds']} "
        f"folds, a training in each. 95% intervals by {result['units']}, of outcomes by Wilson.\n"
    )
    parts = [extent, _errors(models)]
    learned = {title: of for title, (_, of) in models.items() if "parameters" in of}
    if any("people" in of or "world" in of for of in learned.values()):
        none, fades = (result["models"].get(name, {}) for name in ("constant_velocity", "fading_acceleration"))
        controls = {"no reaction (velocities kept)": none, "untrained networks (accelerations fade)": fades}
        parts.append(_people(learned | {title: {"world": of.get("world")} for title, of in controls.items()}))
    return "\n".join(parts)


def _title(name: str) -> str:
    plain = name.removesuffix("_refined")
    title = TABLE_9[plain].name if plain in TABLE_9 else _CONTROLS.get(plain, f"`{plain}`")
    return title + (" +" if plain != name else "")


def _interval(value: float, ends: Sequence[float], digits: int) -> str:
    return f"{value:.{digits}f} [{ends[0]:.{digits}f}, {ends[1]:.{digits}f}]"


def _errors(models: dict[str, tuple[str, dict[str, Any]]]) -> str:
    rows = []
    for title, (name, of) in models.items():
        once, loop, paper = of["reconstruction"], of["closed_loop"], TABLE_9.get(name)
        speeds = [f"{value:.3f}" for value in list(once["rmse"].values())[:6]]
        pairs = [", ".join(speeds[k : k + 2]) for k in (0, 2, 4)]
        share = loop.get("share_of_ma_sst_ddpg")
        cells = [title, *pairs, f"{once['ade']:.4f}", f"{once['fde']:.4f}", f"{paper.ade:.3f}" if paper else ""]
        cells += [
            _interval(loop["ade"], loop["ade_interval"], 3),
            f"{loop['fde']:.3f}",
            _interval(share[0], share[1], 2) if share else "",
        ]
        rows.append(cells)
    heads = ["model", "v_veh long, lat", "v_ped long, lat", "d long, lat", "ADE", "FDE", "paper's ADE"]
    return markdown([*heads, "closed loop: ADE", "FDE", "ADE of MA-SST-DDPG's"], rows)


def _people(models: dict[str, dict[str, Any]]) -> str:
    rows = []
    for title, of in models.items():
        people, world = of.get("people"), of.get("world")
        cells = [title, *[""] * 5]
        if people:
            share = people.get("share_of_ma_sst_ddpg")
            cells[1:] = [
                _interval(people["energy_score"], people["energy_score_interval"], 3),
                _interval(share[0], share[1], 2) if share else "",
                f"{people['brier']:.3f}",
                _interval(people["likelihood"], people["likelihood_interval"], 3),
                _interval(people["c2st_auc"], people["c2st_auc_interval"], 2),
            ]
        cells += [*_rates(world)] if world else [""] * 3
        known = "parameters" in of
        cells += [str(of["parameters"]), f"{of['training_seconds']:.0f}"] if known else ["", ""]
        rows.append([*cells, f"{of['step_microseconds']:.0f}" if known else ""])
    heads = ["model", "energy score [m]", "of MA-SST-DDPG's", "Brier", "likelihood", "classifier", "collisions"]
    more = ["of single trainings", "both goals", "parameters", "training [CPU s]", "step [CPU µs]"]
    return markdown([*heads, *more], rows)


def _rates(world: dict[str, Any]) -> list[str]:
    by_training = world["collision_by_training"]
    (rate, *ends), (goal, *goal_ends) = world["collision"], world["goal"]
    spread = f"{100.0 * min(by_training):.0f} to {100.0 * max(by_training):.0f}%"
    shown = [f"{100.0 * r:.0f}% [{100.0 * e[0]:.0f}, {100.0 * e[1]:.0f}]" for r, e in ((rate, ends), (goal, goal_ends))]
    return [shown[0], spread if len(by_training) > 1 else "", shown[1]]
