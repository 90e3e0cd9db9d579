"""The data of an episode that exporters write: poses, velocities and boxes of road users, and the road.

A pedestrian is taken to face where it walks; while it stands it keeps the heading it had, or has the first one that
comes.
"""

from dataclasses import dataclass

import numpy as np

from vpsci_ros.data.courses import Floats, headings
from vpsci_ros.data.episode import Episode
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import Scenario
from vpsci_ros.world.observation import STEP

VEHICLE_HEIGHT = 1.44  # [m] of the Tesla Model 3, whose length and width CurvTTC uses
PEDESTRIAN_HEIGHT = 1.75  # [m] of an adult; the world is flat and knows none
STANDING = 0.05  # [m/s] below which a pedestrian's velocity says nothing of a heading
BEYOND = 40.0  # [m] of straight lane before the centreline and after it


@dataclass(frozen=True)
class Mover:
    """One road user's motion in map frame, float64[T] each: x east, y north.

    :ivar x, y: centre of its footprint [m].
    :ivar heading: [rad] counter-clockwise from x, unwrapped.
    :ivar vx, vy: velocity [m/s].
    :ivar size: length, width and height of its box [m].
    """

    x: Floats
    y: Floats
    heading: Floats
    vx: Floats
    vy: Floats
    size: tuple[float, float, float]

    @property
    def speed(self) -> Floats:
        """Return the speed of the road user, float64[T] [m/s]."""
        return np.asarray(np.hypot(self.vx, self.vy))


def movers(episode: Episode) -> list[Mover]:
    """Return the vehicle and then the pedestrians of an episode.

    :raises InvalidInput: a frame that nobody saw, or a road user that never moves, whose heading is not known.
    """
    box = episode.length, episode.width, VEHICLE_HEIGHT
    disc = 2.0 * episode.radius, 2.0 * episode.radius, PEDESTRIAN_HEIGHT
    found = [Mover(episode.x, episode.y, episode.heading, episode.vx, episode.vy, box)]
    for x, y, vx, vy in zip(episode.ped_x, episode.ped_y, episode.ped_vx, episode.ped_vy, strict=True):
        found.append(Mover(x, y, headings(vx, vy, STANDING), vx, vy, disc))
    for number, each in enumerate(found):
        where = f"{episode.source}: {'pedestrian' if number else 'vehicle'} of {episode.label}"
        if not np.isfinite([each.x, each.y, each.speed]).all():
            raise InvalidInput(f"{where}: a position or velocity is missing; expected one in each frame")
        if not np.isfinite(each.heading).all():
            raise InvalidInput(f"{where}: never moves, so its heading is unknown; leave this episode out")
    return found


def tenths(episode: Episode) -> slice:
    """Return the slice of the frames at every tenth of a second, from the first on.

    :raises InvalidInput: frames that do not come at whole fractions of it.
    """
    stride = round(STEP / episode.period)
    if stride < 1 or abs(stride * episode.period - STEP) > 1e-6:
        raise InvalidInput(
            f"episode {episode.label}: a frame every {episode.period:g} s; this format has one every {STEP} s, so the "
            "period must be that divided by a whole number"
        )
    return slice(None, None, stride)


def road_of(episode: Episode) -> Scenario:
    """Return the scenario of an episode, for formats that need a road.

    :raises InvalidInput: the source does not hold one.
    """
    if episode.scenario is None:
        raise InvalidInput(
            f"{episode.source}: episode {episode.label}: its recording does not hold the road, and this format needs "
            "one; export it to osi or mp4, which do not"
        )
    return episode.scenario


def lane_lines(road: Scenario) -> tuple[Floats, Floats, Floats]:
    """Return centre, left and right border of the lane, float64[N, 2] [m] each, extended by `BEYOND` at both ends."""
    lane, half = road.vehicle.path, 0.5 * road.vehicle.lane_width
    along = np.arange(-BEYOND, lane.length + BEYOND, lane.step)
    centre, left, right = (np.array([lane.beside(s, aside) for s in along]) for aside in (0.0, half, -half))
    return centre, left, right
