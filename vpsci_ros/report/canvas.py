"""Figures without a display; PNG files are written whole or not at all."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vpsci_ros.runs.files import atomic_write


def blank_figure(width: float, height: float) -> Figure:
    """Return a figure of this size [inch] without axes."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def new_figure(width: float, height: float, rows: int = 1, columns: int = 1, **options: Any) -> tuple[Figure, Any]:
    """Return a figure of this size [inch] and its axes, object[rows, columns].

    :param options: of `Figure.subplots`.
    """
    figure = blank_figure(width, height)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def save_png(figure: Figure, path: str | Path, dpi: int = 130) -> None:
    """Write a figure, whole or not at all.

    :raises InvalidInput: the folder of `path` does not exist.
    """
    with atomic_write(path) as part:
        figure.savefig(part, format="png", dpi=dpi)


def show_all(axis: Axes, points: NDArray[np.float64], margin: float) -> None:
    """Set the axis to a square window around all points, float64[n, 2] [m], with a margin [m]."""
    low, high = points.min(axis=0), points.max(axis=0)
    half, centre = 0.5 * float((high - low).max()) + margin, 0.5 * (low + high)
    axis.set_xlim(centre[0] - half, centre[0] + half)
    axis.set_ylim(centre[1] - half, centre[1] + half)
