"""What the page shows: episodes frame by frame, with what each came to, and the sources that they come from."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import (
    CONFLICT_TTC,
    CRITICAL_TTC,
    PEDESTRIAN_RADIUS,
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    Yielded,
    who_yielded,
)
from vpsci_ros.world import Scenario

Floats = NDArray[np.float64]

FIELDS = (
    "x",  # [m] centre of the vehicle
    "y",  # [m]
    "heading",  # [rad] counter-clockwise from x, without jumps
    "speed",  # [m/s]
    "curvature",  # [1/m] positive to the left
    "ped_x",  # [m] centre of the pedestrian
    "ped_y",  # [m]
    "ped_vx",  # [m/s]
    "ped_vy",  # [m/s]
    "curvttc",  # [s] infinity where no contact is predicted, NaN where it is not known
    "held",  # 1 while the policies hold the agents
)
"""Columns of `Episode.values`."""
_WALK = [FIELDS.index(name) for name in ("ped_x", "ped_y", "ped_vx", "ped_vy")]
YIELDED = ("nobody", "vehicle", "pedestrian", "both")  # by the codes of `Yielded`
RECORDED = "recorded"  # outcome of an interaction of real people, whose end nobody judged


class Size(NamedTuple):
    """Footprints [m]."""

    length: float = VEHICLE_LENGTH
    width: float = VEHICLE_WIDTH
    radius: float = PEDESTRIAN_RADIUS


@dataclass(frozen=True)
class Episode:
    """One interaction of a vehicle and a pedestrian, of several the most critical one.

    :ivar name: by which links find it, unique in its source: "6:12", or the number of the interaction.
    :ivar group: the scenario's name, or the recording's; what the page filters by.
    :ivar scenario: number of the scenario, by which its ground is found; 0 for none.
    :ivar outcome: "collision", "goal", "timeout", "none", or "recorded".
    :ivar yielded: who gave way, one of `YIELDED`.
    :ivar values: float64[T, 11], `FIELDS`.
    :ivar marks: further names that the page filters by, say "hard_braking".
    :ivar others: float64[n, T, 4], x, y [m], vx, vy [m/s] of the other pedestrians.
    """

    name: str
    group: str
    scenario: int
    outcome: str
    yielded: str
    values: Floats
    size: Size = field(default_factory=Size)
    marks: tuple[str, ...] = ()
    others: Floats = field(default_factory=lambda: np.zeros((0, 0, 4)))

    @property
    def curvttc(self) -> Floats:
        """CurvTTC, float64[T] [s], infinity where it is not known."""
        return np.nan_to_num(self.values[:, FIELDS.index("curvttc")], nan=np.inf, posinf=np.inf)

    @property
    def least(self) -> float:
        """Least CurvTTC [s]."""
        return float(self.curvttc.min())


@dataclass(frozen=True)
class Source:
    """Episodes of one kind.

    :ivar key: by which links find it, unique on its page.
    :ivar title: as people read it.
    :ivar period: time from one frame to the next [s].
    :ivar total: episodes that there are, of which `episodes` may be a part.
    :ivar scenarios: of one's own, where they take place.
    """

    key: str
    title: str
    period: float
    episodes: Sequence[Episode]
    total: int
    scenarios: Sequence[Scenario] = ()


def judged(values: Floats, period: float, size: Size) -> tuple[str, tuple[str, ...]]:
    """Return who gave way, and the marks that hold (critical, conflict, ...), of an interaction float64[T, 11]."""
    x, y, heading, speed, _, *walk, curvttc, _ = values.T
    ttc = np.nan_to_num(curvttc, nan=np.inf, posinf=np.inf)
    motion = (x, y, heading, speed, walk[0], walk[1], walk[2], walk[3], ttc)
    code = who_yielded(*motion, dt=period, length=size.length, width=size.width)
    holds = {
        "critical": ttc.min() < CRITICAL_TTC,
        "conflict": ttc.min() < CONFLICT_TTC,
        "vehicle_yields": int(code) & Yielded.VEHICLE,
        "pedestrian_yields": int(code) & Yielded.PEDESTRIAN,
    }
    return YIELDED[int(code)], tuple(name for name, held in holds.items() if held)


def most_critical(pairs: Floats) -> tuple[Floats, Floats]:
    """Return of float64[n, T, 11], the pairs of one episode, that with the least CurvTTC, and the others' motion."""
    curvttc = np.nan_to_num(pairs[..., FIELDS.index("curvttc")], nan=np.inf, posinf=np.inf)
    chosen = int(curvttc.min(axis=1).argmin())
    return pairs[chosen], np.delete(pairs, chosen, axis=0)[..., _WALK]


def spread(total: int, limit: int) -> NDArray[np.int64]:
    """Return which of `total` episodes are shown where at most `limit` may be: all, or evenly spread ones."""
    return (
        np.unique(np.linspace(0, total - 1, min(total, limit)).round().astype(np.int64)) if total else np.zeros(0, int)
    )


def named(names: Sequence[str], wanted: Sequence[str], where: str) -> NDArray[np.int64]:
    """Return the rows of `names` that are wanted.

    :raises InvalidInput: one that is not there; `where` opens the message.
    """
    place = {name: row for row, name in enumerate(names)}
    for name in wanted:
        if name not in place:
            some = ", ".join(list(names)[:8]) + (f", ... {len(names)} in all" if len(names) > 8 else "")
            raise InvalidInput(f"{where}: no episode {name}; it has {some or 'none'}")
    return np.array(sorted(place[name] for name in wanted), np.int64)
