"""What an importer is: a format's name stands for a function from a folder to clips, and for the size of its vehicles.

The built-in ones are listed in `run`; other distributions add theirs by entry points, see `docs/extending.md`.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from vpsci_ros.data.importers.tracks import Track

BACKWARDS = "frames of vehicles that drive backwards"  # a count of `Clip.left_out`


@dataclass(frozen=True)
class Clip:
    """One recording: tracks on the 0.1 s grid under the near-miss table's names, without their `veh_` and `ped_`.

    Vehicles have x, y, heading, speed, pedestrians x, y, vx, vy (float64[T]), right-handed, in metres, m/s and radians
    counter-clockwise from x. `left_out` counts what is not among them by what it is, say frames of vehicles that drive
    backwards, which is not a near miss that CurvTTC describes. `assumed` says in a few words what the recording does
    not hold.
    """

    name: str
    vehicles: list[Track]
    pedestrians: list[Track]
    left_out: Mapping[str, int] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()

    def with_size(self, length: float, width: float) -> "Clip":
        """Return the clip with this size [m] for vehicles whose tracks have none."""
        return replace(self, vehicles=[replace(each, size=each.size or (length, width)) for each in self.vehicles])


@dataclass(frozen=True)
class Importer:
    """How recordings of one format are read.

    :ivar read: folder of recordings -> its clips, in an order of its own that is always the same; raises
        `InvalidInput` where the folder or a file does not hold what it should.
    :ivar length, width: of a vehicle [m] whose track does not say.
    """

    read: Callable[[Path], Iterable[Clip]]
    length: float
    width: float
