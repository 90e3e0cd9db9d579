"""A picture of the measures of realism: energy score, likelihood and the classifier's area under the curve."""

from pathlib import Path
from typing import Any

import numpy as np

from vpsci_ros.report.canvas import new_figure, save_png

_COLUMNS = (
    ("of_constant_velocity", "energy score, of constant velocity's\n(less is better)", 1.0),
    ("likelihood", "likelihood\n(more is better)", None),
    ("c2st_auc", "classifier's area under the curve\n(0.5: it cannot separate them)", 0.5),
)


def save_realism(result: dict[str, Any], path: Path) -> None:
    """Draw Protocol A's models in three columns, each with its 95% interval, as PNG."""
    models = result["same_start"]["models"]
    names = list(models)
    figure, (axes,) = new_figure(11.0, 1.2 + 0.35 * len(names), 1, len(_COLUMNS), sharey=True)
    place = np.arange(len(names))[::-1]
    for axis, (key, title, line) in zip(axes, _COLUMNS, strict=True):
        values = np.array([models[name][key] for name in names])
        bounds = np.array([models[name][f"{key}_interval"] for name in names])
        axis.hlines(place, bounds[:, 0], bounds[:, 1], color="0.6", linewidth=2.0)
        axis.plot(values, place, "o", color="tab:blue")
        axis.set_title(title, fontsize=9)
        axis.grid(axis="x", alpha=0.3)
        if line is not None:
            axis.axvline(line, color="0.3", linewidth=0.8, linestyle="--")
    axes[0].set_yticks(place, [name.replace("_", " ") for name in names])
    part = result["same_start"]
    figure.suptitle(f"{part['interactions']} recorded onsets of {part['clips']} clips, 3 s", fontsize=10)
    save_png(figure, path)
