"""Table 9's columns as text."""

from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table


def print_errors(result: dict[str, Any], console: Console) -> None:
    """Print what `errors.evaluate` or `cross_validation.cross_validate` returned, in 80 columns."""
    title = f"{result['interactions']} interactions of {result['clips']} clips, mean error in metres"
    view = Table(box=box.SIMPLE_HEAD, title=title, padding=(0, 1, 0, 0))
    view.add_column("", no_wrap=True)
    for name in ("recon-\nstruction\nADE", "\n\nFDE", "closed\nloop\nADE", "\n\nFDE", "\nits share of\nthe control's"):
        view.add_column(name, justify="right", no_wrap=True)
    for name, errors in result["models"].items():
        reconstruction, loop = errors["reconstruction"], errors["closed_loop"]
        ratio = "{:.2f} ({:.2f}-{:.2f})".format(loop["ade_ratio"], *loop["ade_ratio_interval"])
        cells = [f"{value:.3f}" for value in (reconstruction["ade"], reconstruction["fde"], loop["ade"], loop["fde"])]
        view.add_row(name, *cells, ratio)
    console.print(view)
    console.print(
        "The control is repeat_velocity. constant_velocity_tracked starts its closed loop from the vehicle's velocity "
        "by its last positions, as the policies do; the other controls from the recorded one. Intervals: 95%, clips "
        "resampled.",
        highlight=False,
    )
    if fixed := result.get("fixed_3s"):
        _print_fixed(result, fixed, console)


def _print_fixed(result: dict[str, Any], fixed: dict[str, Any], console: Console) -> None:
    title = f"3 s from the onset of {fixed['interactions']} interactions of {fixed['clips']} clips"
    view = Table(box=box.SIMPLE_HEAD, title=title, padding=(0, 1, 0, 0))
    view.add_column("", no_wrap=True)
    for name in ("roll-\nouts", "\nADE [m]", "energy\nscore [m]", "its share of tracked\nconstant velocity's"):
        view.add_column(name, justify="right", no_wrap=True)
    for name, own in ((name, of["fixed_3s"]) for name, of in result["models"].items() if "fixed_3s" in of):
        share = "{:.2f} ({:.2f}-{:.2f})".format(own["of_constant_velocity"], *own["of_constant_velocity_interval"])
        view.add_row(name, str(own["roll_outs"]), f"{own['ade']:.3f}", f"{own['energy_score']:.3f}", share)
    console.print(view)
