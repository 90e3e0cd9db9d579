"""The errors of models as text, with the columns of Table 9."""

from typing import Any

from rich.console import Console

from vpsci_ros.runs.text_table import text_table


def print_errors(result: dict[str, Any], console: Console) -> None:
    """Print what `errors.evaluate` returned, in 80 columns."""
    title = f"{result['interactions']} interactions of {result['clips']} clips, mean error in metres"
    heads = ["", "recon-\nstruction\nADE", "\n\nFDE", "closed\nloop\nADE", "\n\nFDE", "\nits share of\nthe control's"]
    rows = []
    for name, errors in result["models"].items():
        if "closed_loop" not in errors:
            continue  # the sampler has the 3 s after the onset alone
        loop = errors["closed_loop"]
        cells = [f"{of[key]:.3f}" for of in (errors["reconstruction"], loop) for key in ("ade", "fde")]
        rows.append((name, *cells, share_text(loop["ade_ratio"], loop["ade_ratio_interval"])))
    console.print(text_table(title, heads, rows))
    console.print(
        "The control is repeat_velocity. constant_velocity_tracked starts its closed loop from the vehicle's velocity "
        "by its last positions, as banks of people and fading_acceleration do; other controls and networks from the "
        "recorded one. fading_acceleration repeats the last acceleration in reconstruction. "
        f"Intervals: 95%, {result['units']} resampled.",
        highlight=False,
    )
    if fixed := result.get("fixed_3s"):
        title = f"3 s from the onset of {fixed['interactions']} interactions of {fixed['clips']} clips"
        title += f", intervals by {fixed['units']}" if fixed["units"] != result["units"] else ""
        heads = [
            "",
            "roll-\nouts",
            "\nADE [m]",
            "share of\nfading's",
            "energy\nscore [m]",
            "its share of tracked\nconstant velocity's",
        ]
        rows = []
        for name, own in ((name, of["fixed_3s"]) for name, of in result["models"].items() if "fixed_3s" in of):
            share = share_text(own["of_constant_velocity"], own["of_constant_velocity_interval"])
            ade = f"{own['ade']:.3f}", f"{own['ade_of_fading_acceleration']:.2f}"
            rows.append((name, f"{own['roll_outs']}", *ade, f"{own['energy_score']:.3f}", share))
        console.print(text_table(title, heads, rows))


def share_text(value: float, interval: list[float]) -> str:
    """Return a share with its interval as text, such as "0.85 (0.80-0.91)"."""
    digits = 2 if value < 10.0 else 1
    return f"{value:.{digits}f} ({interval[0]:.{digits}f}-{interval[1]:.{digits}f})"
