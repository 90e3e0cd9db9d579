"""Lines to follow: the lane's centreline for the vehicle, the walking route for the pedestrian.

A `Path` is a polyline sampled at equal steps along its length, so that the place at arc length s is found without a
search, and a table of paths is a few rectangular arrays for compiled code. Beyond its ends a path goes on straight.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.compiled import kernel

SAMPLE = 0.5  # [m] wanted distance between samples
STRAIGHT = 5.0  # [m] given points further apart than this have a straight line between them
LONGEST = 20e3  # [m] of a way; more of it would be sampled for nothing


@dataclass(frozen=True)
class Path:
    """A polyline sampled at equal steps: `points` float64[N, 2] [m], `step` [m] from one sample to the next."""

    points: NDArray[np.float64]
    step: float

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return self.step * (len(self.points) - 1)

    def at(self, s: float) -> tuple[float, float]:
        """Return the point (x, y) [m] at arc length `s` [m]."""
        return point_at(self.points[None], 0, len(self.points), self.step, s)

    def heading(self, s: float) -> float:
        """Return the direction [rad] of the path at arc length `s` [m]."""
        x0, y0 = self.at(s - 0.5 * self.step)
        x1, y1 = self.at(s + 0.5 * self.step)
        return math.atan2(y1 - y0, x1 - x0)

    def locate(self, x: float, y: float) -> tuple[float, float]:
        """Return the arc length [m] of the path's point nearest to (x, y), and how far left of it (x, y) lies [m]."""
        nearest = int(np.argmin(np.hypot(self.points[:, 0] - x, self.points[:, 1] - y)))
        return project(self.points[None], 0, len(self.points), self.step, x, y, nearest * self.step)

    def follow(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the arc lengths float64[T] [m] of consecutive places float64[T] [m], each searched around the last."""
        out = np.empty(len(x))
        _follow(self.points[None], len(self.points), self.step, x, y, self.locate(float(x[0]), float(y[0]))[0], out)
        return out

    def beside(self, s: float, left: float) -> tuple[float, float]:
        """Return the point (x, y) [m] at arc length `s`, `left` [m] to the left of the path."""
        (x, y), heading = self.at(s), self.heading(s)
        return x - left * math.sin(heading), y + left * math.cos(heading)

    def band(self, width: float) -> NDArray[np.float64]:
        """Return the outline, float64[2 N, 2] [m], of a band of `width` [m] along the path."""
        along = np.arange(len(self.points)) * self.step
        left, right = ([self.beside(s, side * width) for s in along] for side in (0.5, -0.5))
        return np.array(left + right[::-1])

    def curvature(self, window: float = 3.0) -> NDArray[np.float64]:
        """Return the curvature [1/m] at each sample, float64[N], from its change of heading over `window` [m]."""
        s = np.arange(len(self.points)) * self.step
        ahead = np.array([self.heading(v + 0.5 * window) for v in s])
        behind = np.array([self.heading(v - 0.5 * window) for v in s])
        turn = (ahead - behind + math.pi) % (2.0 * math.pi) - math.pi
        return np.asarray(turn / window)


def resample(points: NDArray[np.float64], sample: float = SAMPLE) -> Path:
    """Return a polyline float64[N, 2] [m] as a `Path` with samples about `sample` [m] apart.

    A cubic joins the given points (Catmull and Rom's, over chord lengths), so that points two metres apart describe the
    arc of a turn to a centimetre; points more than `STRAIGHT` apart are joined by a straight line.

    :raises InvalidInput: a polyline longer than `LONGEST`.
    """
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    if not length <= LONGEST:
        raise InvalidInput(f"expected a way of at most {LONGEST:,g} m, got one of {length:,.4g} m; are these metres?")
    dense = _catmull_rom(_with_straights(points))
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(dense, axis=0).T))])
    count = max(1, round(lengths[-1] / sample))
    s = np.linspace(0.0, lengths[-1], count + 1)
    sampled = np.stack([np.interp(s, lengths, dense[:, k]) for k in (0, 1)], axis=1)
    return Path(np.ascontiguousarray(sampled), float(lengths[-1] / count))


def _with_straights(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `points` with others put in on spans above `STRAIGHT`, so that a curve beside them does not bulge them."""
    pieces = []
    for begin, end in itertools.pairwise(points):
        length = math.dist(begin, end)
        count = math.ceil(length / 2.0) if length > STRAIGHT else 1
        pieces.append(begin + (end - begin) * (np.arange(count) / count)[:, None])
    return np.concatenate([*pieces, points[-1:]])


def _catmull_rom(points: NDArray[np.float64], between: int = 16) -> NDArray[np.float64]:
    """Return the cubic Hermite curve through `points` with non-uniform Catmull-Rom tangents, `between` steps a span."""
    chord = np.hypot(*np.diff(points, axis=0).T)
    slope = np.diff(points, axis=0) / chord[:, None]
    tangent = np.concatenate([slope[:1], slope[1:], slope[-1:]])
    before, after = chord[:-1, None], chord[1:, None]
    tangent[1:-1] = (after * slope[:-1] + before * slope[1:]) / (before + after)
    tangent[[0, -1]] = 2.0 * slope[[0, -1]] - tangent[[1, -2]]  # the first and the last span are parabolas
    u = np.linspace(0.0, 1.0, between, endpoint=False)[None, :, None]
    h = chord[:, None, None]
    p0, p1, m0, m1 = points[:-1, None], points[1:, None], tangent[:-1, None] * h, tangent[1:, None] * h
    curve = (2 * u**3 - 3 * u**2 + 1) * p0 + (u**3 - 2 * u**2 + u) * m0
    curve = curve + (3 * u**2 - 2 * u**3) * p1 + (u**3 - u**2) * m1
    return np.concatenate([curve.reshape(-1, 2), points[-1:]])


@kernel
def point_at(points, row, count, step, s):  # type: ignore[no-untyped-def]
    """Return the point (x, y) [m] at arc length `s` [m] of path `row` of a table float64[S, N, 2]."""
    i = min(max(int(math.floor(s / step)), 0), count - 2)
    u = s / step - i
    x = points[row, i, 0] + u * (points[row, i + 1, 0] - points[row, i, 0])
    y = points[row, i, 1] + u * (points[row, i + 1, 1] - points[row, i, 1])
    return x, y


@kernel
def line_at(points, row, count, step, s):  # type: ignore[no-untyped-def]
    """Return the point (x, y) [m] at arc length `s` [m] of path `row`, and the direction (ux, uy) of its next step."""
    x, y = point_at(points, row, count, step, s)
    ahead_x, ahead_y = point_at(points, row, count, step, s + step)
    return x, y, (ahead_x - x) / step, (ahead_y - y) / step


@kernel
def project(points, row, count, step, x, y, near):  # type: ignore[no-untyped-def]
    """Return (arc length, distance to the left) [m] of (x, y) at the nearest place around arc length `near`."""
    i = min(max(int(math.floor(near / step)), 0), count - 2)
    came = 0
    while True:
        ux, uy = points[row, i + 1, 0] - points[row, i, 0], points[row, i + 1, 1] - points[row, i, 1]
        dx, dy = x - points[row, i, 0], y - points[row, i, 1]
        square = ux * ux + uy * uy
        u = (dx * ux + dy * uy) / square
        if u > 1.0 and i < count - 2 and came >= 0:
            i, came = i + 1, 1
        elif u < 0.0 and i > 0 and came <= 0:
            i, came = i - 1, -1
        else:
            break
    if (u < 0.0 and i > 0) or (u > 1.0 and i < count - 2):
        u = min(max(u, 0.0), 1.0)  # outside a corner: the corner itself is nearest
    left = (ux * dy - uy * dx) / math.sqrt(square)
    return (i + u) * step, left


@kernel
def _follow(points, count, step, x, y, near, out):  # type: ignore[no-untyped-def]
    for i in range(x.size):
        near, _ = project(points, 0, count, step, x[i], y[i], near)
        out[i] = near


@kernel
def nearest(points, row, count, step, x, y):  # type: ignore[no-untyped-def]
    """Arc length [m] of the place on path `row` nearest to (x, y), searched over the whole path."""
    best, least = 0, math.inf
    for i in range(count):
        square = (points[row, i, 0] - x) ** 2 + (points[row, i, 1] - y) ** 2
        if square < least:
            best, least = i, square
    s, _ = project(points, row, count, step, x, y, best * step)
    return s
