"""One episode as every format needs it: where each road user was at each frame, which way it faced, and on which road.

Datasets hold velocities and no headings. A vehicle moves along its heading, and a pedestrian is taken to face where it
walks; whoever stands keeps the heading it had, or has the first one that comes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import Scenario

Floats = NDArray[np.float64]
VEHICLE_HEIGHT = 1.44  # [m] of the Model 3, whose length and width CurvTTC uses
PEDESTRIAN_HEIGHT = 1.75  # [m] of an adult; the world is flat and knows none
STANDING = 0.05  # [m/s] below which a velocity says nothing of a heading


@dataclass(frozen=True)
class Motion:
    """One road user's motion in map frame, float64[T] each: x east, y north.

    :ivar x, y: centre of its footprint [m].
    :ivar heading: [rad] counter-clockwise from x, unwrapped.
    :ivar vx, vy: velocity [m/s].
    """

    x: Floats
    y: Floats
    heading: Floats
    vx: Floats
    vy: Floats

    @property
    def speed(self) -> Floats:
        """Return the speed [m/s]."""
        return np.asarray(np.hypot(self.vx, self.vy))

    def acceleration(self, period: float) -> tuple[Floats, Floats]:
        """Return the change of velocity per time [m/s2] in x and y; zeros of a single frame."""
        if len(self.x) < 2:
            return np.zeros(len(self.x)), np.zeros(len(self.x))
        ax, ay = (np.gradient(values, period).astype(np.float64) for values in (self.vx, self.vy))
        return ax, ay


@dataclass(frozen=True)
class Episode:
    """One vehicle and the pedestrians that it met.

    :ivar name: of a file, unique in its source: scenario and number, "LocationA_PedCross_S-N_000012".
    :ivar number: within its scenario.
    :ivar scenario: the road; None where the recording does not know one.
    :ivar period: time from one frame to the next [s].
    :ivar outcome: "collision", "goal", "timeout", or "none" where it is not known.
    :ivar pedestrians: one or more.
    :ivar curvttc: float64[T] [s], infinity where no contact is predicted, NaN where nobody computed it.
    """

    name: str
    number: int
    scenario: Scenario | None
    period: float
    outcome: str
    vehicle: Motion
    pedestrians: tuple[Motion, ...]
    curvttc: Floats

    @property
    def time(self) -> Floats:
        """Return the time since the first frame [s]; float64[T]."""
        return np.arange(len(self.vehicle.x), dtype=np.float64) * self.period

    @property
    def road(self) -> Scenario:
        """Return the scenario, for formats that need a road.

        :raises InvalidInput: the recording does not know one.
        """
        if self.scenario is None:
            raise InvalidInput(
                f"episode {self.name}: its recording does not tell the road (odometry alone), and this format needs "
                "one; export it to osi or carla-csv, which do not"
            )
        return self.scenario


def motion(columns: Floats, where: str) -> Motion:
    """Return a motion whose headings are those of its velocities.

    :param columns: float64[4, T]: x, y [m], vx, vy [m/s].
    :param where: episode and road user, the opening of an error message.
    :raises InvalidInput: a value that nobody saw (NaN), or a road user that never moves, whose heading is not known.
    """
    x, y, vx, vy = columns
    if not np.isfinite(columns).all():
        raise InvalidInput(f"{where}: a position or velocity is missing; expected one in each frame")
    moving = np.flatnonzero(np.hypot(vx, vy) > STANDING)
    if len(moving) == 0:
        raise InvalidInput(f"{where}: never moves, so its heading is unknown; leave this episode out")
    last = np.maximum(np.searchsorted(moving, np.arange(len(x)), side="right") - 1, 0)
    heading = np.unwrap(np.arctan2(vy, vx)[moving[last]])
    return Motion(x, y, heading, vx, vy)
