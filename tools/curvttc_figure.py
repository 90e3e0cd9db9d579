"""The pictures of docs/curvttc.md: what CurvTTC is, how it is found, and what it is at the edges of the definition.

python tools/curvttc_figure.py docs/curvttc.png
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from vpsci_ros.runs.files import atomic_write
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance, curvttc

Floats = NDArray[np.float64]
VEHICLE, WALKER, CONTACT, QUIET = "#2b5c8a", "#b5432d", "#222222", "#777777"


@dataclass(frozen=True)
class Situation:
    """A vehicle at the origin heading along x, and a pedestrian."""

    speed: float  # [m/s] of the vehicle
    curvature: float  # [1/m] of its path
    ped_x: float  # [m]
    ped_y: float  # [m]
    ped_vx: float  # [m/s]
    ped_vy: float  # [m/s]
    title: str = ""

    @property
    def ttc(self) -> float:
        """CurvTTC [s]."""
        walker = (self.ped_x, self.ped_y, self.ped_vx, self.ped_vy)
        return float(curvttc(0.0, 0.0, 0.0, self.speed, self.curvature, *walker))

    @property
    def end(self) -> float:
        """How long the motion is predicted [s]: 10 s, or 90 degrees of the arc."""
        turning = abs(self.speed * self.curvature)
        return min(10.0, 0.5 * math.pi / turning) if turning else 10.0

    def vehicle(self, t: float) -> tuple[float, float, float]:
        """Pose of the vehicle after t seconds [m], [m], [rad]."""
        half = 0.5 * self.speed * self.curvature * t
        chord = self.speed * t * float(np.sinc(half / math.pi))
        return chord * math.cos(half), chord * math.sin(half), 2.0 * half

    def walker(self, t: float) -> tuple[float, float]:
        """Position of the pedestrian after t seconds [m]."""
        return self.ped_x + self.ped_vx * t, self.ped_y + self.ped_vy * t

    def free(self, t: float) -> float:
        """Free distance after t seconds [m]."""
        return float(clearance(*self.vehicle(t), *self.walker(t)))


TURN = Situation(4.5, 1 / 9.0, 12.4, 8.4, -1.35, -0.1)
EDGES = (
    Situation(5.0, 0.0, 14.0, -4.2, 0.0, 1.5, "straight path"),
    Situation(0.0, 0.1, 1.0, 5.0, 0.1, -1.3, "standing vehicle"),
    Situation(5.0, 0.1, 2.2, 1.1, 0.0, 1.0, "touching now"),
    Situation(4.0, 1 / 4.5, 1.2, 8.6, 0.0, 0.0, "beyond 90 degrees"),
)


def draw_curvttc(path: str | Path) -> None:
    """Draw the definition of CurvTTC as PNG.

    :raises OSError: `path` cannot be written.
    """
    figure = Figure(figsize=(11.0, 8.6), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 1, height_ratios=(1.75, 1.0))
    top, bottom = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    scene, advance = top.subplots(1, 2, width_ratios=(1.15, 1.0))
    _turn(scene, TURN)
    _advancement(advance, TURN)
    for axes, edge in zip(bottom.subplots(1, len(EDGES)), EDGES, strict=True):
        _edge(axes, edge)
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=130, format="png", metadata={"Software": None})


def _turn(axes: Axes, scene: Situation) -> None:
    """Draw the turning vehicle, the walking pedestrian, and both of them at contact."""
    for t in np.arange(0.0, scene.end + 0.01, 0.5):
        past = t > scene.ttc
        _rectangle(axes, scene.vehicle(t), alpha=0.05 if past else 0.16)
        _disc(axes, scene.walker(t), alpha=0.08 if past else 0.22)
    times = np.linspace(0.0, scene.end, 80)
    arc = np.array([scene.vehicle(t)[:2] for t in times])
    walk = np.array([scene.walker(t) for t in times])
    axes.plot(*arc.T, color=VEHICLE, lw=1.2)
    axes.plot(*walk.T, color=WALKER, lw=1.2)
    for t in (0.0, scene.ttc):
        _rectangle(axes, scene.vehicle(t), alpha=0.45)
        _disc(axes, scene.walker(t), alpha=0.7)
    center = (0.0, 1.0 / scene.curvature)
    for point in ((0.0, 0.0), tuple(arc[-1])):
        axes.plot(*zip(center, point, strict=True), color=QUIET, lw=0.8, ls=":")
    axes.plot(*center, "+", color=QUIET)
    axes.annotate("turning centre", center, (-3.2, 9.6), fontsize=9, color=QUIET)
    axes.annotate("the prediction ends\nafter 90 degrees", arc[-1], (4.6, 11.3), fontsize=9, color=QUIET)
    axes.annotate("vehicle: constant speed,\ncircular arc", (-2.2, -2.6), fontsize=9, color=VEHICLE)
    axes.annotate("pedestrian:\nconstant velocity", scene.walker(0.0), (12.0, 9.4), fontsize=9, color=WALKER)
    x, y = scene.walker(scene.ttc)
    axes.annotate(
        f"first contact\nafter CurvTTC = {scene.ttc:.2f} s",
        (x - 0.2, y - 0.2),
        (9.3, 1.2),
        fontsize=10,
        color=CONTACT,
        arrowprops={"arrowstyle": "->", "color": CONTACT},
    )
    axes.set(xlim=(-4.5, 16.5), ylim=(-3.6, 13.2), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.set_title("Both are carried on, and their footprints watched", fontsize=11, loc="left")


def _advancement(axes: Axes, scene: Situation) -> None:
    """Draw the free distance over time, and the parabolas below it whose roots are the steps."""
    times = np.linspace(0.0, scene.end, 400)
    axes.axhline(0.0, color=QUIET, lw=0.8)
    axes.plot(times, [scene.free(t) for t in times], color=CONTACT, lw=1.6, label="free distance c(t)")
    yaw_rate = scene.speed * scene.curvature
    pace = math.hypot(scene.ped_vx, scene.ped_vy)
    away = max(math.dist(scene.walker(t), (0.0, 1.0 / scene.curvature)) for t in (0.0, scene.end))
    bound = 2.0 * yaw_rate * pace + yaw_rate**2 * away
    t, count = 0.0, 0
    while scene.free(t) > 1e-3:
        free, rate = scene.free(t), (scene.free(t + 1e-6) - scene.free(t)) / 1e-6
        step = 2.0 * free / (math.sqrt(rate * rate + 2.0 * bound * free) - rate)
        h = np.linspace(0.0, step, 60)
        axes.plot(
            t + h,
            free + rate * h - 0.5 * bound * h**2,
            color=VEHICLE,
            lw=1.0,
            alpha=0.8,
            label=_once(count, "c + c'h - Ah²/2"),
        )
        axes.plot(t, free, "o", color=VEHICLE, ms=4)
        t, count = t + step, count + 1
    axes.plot(t, 0.0, "o", color=WALKER, ms=6)
    axes.annotate(
        f"CurvTTC, after {count} steps",
        (t, 0.0),
        (0.25, 1.1),
        fontsize=10,
        arrowprops={"arrowstyle": "->", "color": CONTACT},
    )
    axes.set(xlim=(0.0, scene.end), ylim=(-1.4, 12.9), xlabel="time ahead [s]", ylabel="between the outlines [m]")
    axes.legend(fontsize=9, frameon=False)
    axes.set_title("No contact can lie within a step", fontsize=11, loc="left")


def _once(count: int, label: str) -> str | None:
    return label if count == 0 else None


def _edge(axes: Axes, scene: Situation) -> None:
    """Draw one scene at the edge of the definition, with its number."""
    until = min(scene.ttc, scene.end)
    for t in {0.0, until}:
        _rectangle(axes, scene.vehicle(t), alpha=0.4 if t == until else 0.16)
        _disc(axes, scene.walker(t), alpha=0.7 if t == until else 0.3)
    times = np.linspace(0.0, until, 40)
    axes.plot(*np.array([scene.vehicle(t)[:2] for t in times]).T, color=VEHICLE, lw=1.2)
    axes.plot(*np.array([scene.walker(t) for t in times]).T, color=WALKER, lw=1.2)
    value = "infinity" if math.isinf(scene.ttc) else f"{scene.ttc:.2f} s" if scene.ttc else "0"
    axes.set_title(f"{scene.title}: {value}", fontsize=10, loc="left")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    axes.tick_params(labelsize=8)


def _rectangle(axes: Axes, pose: tuple[float, float, float], alpha: float) -> None:
    x, y, heading = pose
    forward = 0.5 * VEHICLE_LENGTH * np.array([math.cos(heading), math.sin(heading)])
    left = 0.5 * VEHICLE_WIDTH * np.array([-math.sin(heading), math.cos(heading)])
    corners = np.array([x, y]) + np.stack([forward + left, left - forward, -forward - left, forward - left])
    axes.add_patch(Polygon(corners, facecolor=VEHICLE, edgecolor=VEHICLE, alpha=alpha, lw=0.8))


def _disc(axes: Axes, at: tuple[float, float], alpha: float) -> None:
    axes.add_patch(Circle(at, PEDESTRIAN_RADIUS, facecolor=WALKER, edgecolor=WALKER, alpha=alpha, lw=0.8))


if __name__ == "__main__":
    draw_curvttc(sys.argv[1] if len(sys.argv) > 1 else "docs/curvttc.png")
