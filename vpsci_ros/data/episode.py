"""An episode of motion, recorded or simulated: one vehicle and the pedestrians that it meets.

`Episode` is the type for work on single episodes. Datasets, exams and exported bags store them in one table,
`dataset_tables.EPISODE_COLUMNS`. `view.episode_sources.read_episodes` reads near-miss tables, datasets and bags.
Values that were not observed are NaN; `filled` replaces these.
"""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.courses import directions, filled
from vpsci_ros.documents import counted
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, who_yielded
from vpsci_ros.world import COLLISION, OUTCOME_NAMES, Scenario

Floats = NDArray[np.float64]
Key = tuple[int, int]  # number of the scenario, number of the episode within it
RECORDED = "recorded"  # outcome of an interaction of real people, whose end nobody classified
YIELDED = ("nobody", "vehicle", "pedestrian", "both")  # by the codes of `Yielded`
_MOTION = ("x", "y", "heading", "speed", "curvature", "ped_x", "ped_y", "ped_vx", "ped_vy", "distance")
BATCH = 512  # episodes that are classified at once
_OF_PEDESTRIANS = ("ped_x", "ped_y", "ped_vx", "ped_vy", "curvttc", "distance", "controlled", "seen")

QUANTITIES = (
    "position_x_av",
    "position_y_av",
    "velocity_x_av",
    "velocity_y_av",
    "position_x_ped",
    "position_y_ped",
    "velocity_x_ped",
    "velocity_y_ped",
    "distance",
    "CurvTTC",
    "heading_av",
    "speed_av",
    "curvature_av",
    "controlled",
    "seen",
)
"""The columns of stored episodes that change from frame to frame, see `vpsci_ros.data.dataset_tables`."""


class Listed(NamedTuple):
    """An episode's metadata, without its motion.

    :ivar name: by which it is found, unique in its source: "6:12", or the number of a recorded interaction.
    :ivar group: name of its scenario, or "source/clip" of a recording.
    :ivar scenario, number: its key.
    :ivar outcome: see `Episode`.
    :ivar least_curvttc: [s], infinity where no contact was ever predicted.
    """

    name: str
    group: str
    scenario: int
    number: int
    outcome: str
    least_curvttc: float

    @classmethod
    def simulated(cls, key: Key, scenario: Scenario | None, outcome: str, least_curvttc: float) -> "Listed":
        """Return the metadata of a simulated episode; its group is a placeholder where the scenario is unknown."""
        group = scenario.name if scenario else f"scenario_{key[0]}"
        return cls(f"{key[0]}:{key[1]}", group, *key, outcome, least_curvttc)

    @property
    def label(self) -> str:
        """Name of the episode for files, unique in its source: "LocationA_PedCross_S-N_000012"."""
        return f"{self.group.replace('/', '_')}_{self.number:06d}"

    @property
    def key(self) -> Key:
        """Number of the scenario (0 for none) and number of the episode."""
        return self.scenario, self.number


@dataclass(frozen=True, eq=False, repr=False)
class Episode:
    """One vehicle and n >= 1 pedestrians over T frames, in map frame: x east, y north.

    :ivar source: what it was read from, the opening of an error message.
    :ivar listed: its name, group, key, outcome and least CurvTTC. The outcome is "collision", "goal", "timeout",
        "parked_collision", "none" where nobody knows it, or "recorded".
    :ivar scenario: where it took place; None where its source does not hold that.
    :ivar period: time from one frame to the next [s].
    :ivar x, y: float64[T] [m], centre of the vehicle.
    :ivar heading: float64[T] [rad] counter-clockwise from x, unwrapped; known in every frame, or NaN in all.
    :ivar speed: float64[T] [m/s] along the heading.
    :ivar curvature: float64[T] [1/m] of the vehicle's path, positive to the left.
    :ivar ped_x, ped_y, ped_vx, ped_vy: float64[n, T] [m], [m/s], centres of the pedestrians and their velocities.
    :ivar curvttc: float64[n, T] [s], infinity where no contact is predicted, NaN where it was not computed.
    :ivar distance: float64[n, T] [m] between the centres.
    :ivar controlled: bool[n, T], the policies control the vehicle and this pedestrian.
    :ivar seen: bool[n, T], no parked vehicle hides the pedestrian; false where the frame was not observed.
    :ivar kinds: of the pedestrians, of `vpsci_ros.world.kinds.KINDS`; empty where its source does not hold them.
    :ivar length, width, radius: footprints [m].
    :ivar marks: labels that its source gives it, such as "standing".
    """

    source: str
    listed: Listed
    scenario: Scenario | None
    period: float
    x: Floats
    y: Floats
    heading: Floats
    speed: Floats
    curvature: Floats
    ped_x: Floats
    ped_y: Floats
    ped_vx: Floats
    ped_vy: Floats
    curvttc: Floats
    distance: Floats
    controlled: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    length: float = VEHICLE_LENGTH
    width: float = VEHICLE_WIDTH
    radius: float = PEDESTRIAN_RADIUS
    marks: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()

    @classmethod
    def from_values(
        cls, source: str, listed: Listed, scenario: Scenario | None, period: float, values: NDArray[Any], **more: Any
    ) -> "Episode":
        """Return the episode of values[n, T, 15], `QUANTITIES` of its pedestrians; it begins at its first known frame.

        :param more: `marks`, `kinds` and sizes.
        """
        x, y, _, _, px, py, pvx, pvy, distance, curvttc, heading, speed, curvature, controlled, seen = (
            np.ascontiguousarray(np.moveaxis(values, -1, 0)[..., _first_known(values) :], np.float64)
        )
        vehicle = x[0], y[0], directions(heading[0], ~np.isnan(heading[0])), speed[0], curvature[0]
        walk = px, py, pvx, pvy, curvttc, distance, controlled == 1.0, seen == 1.0
        return cls(source, listed, scenario, period, *vehicle, *walk, **more)

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.x)

    def __repr__(self) -> str:
        people = counted(len(self.ped_x), "pedestrian")
        return f"Episode({self.name}, {self.listed.outcome}, {len(self)} frames, {people})"

    @property
    def name(self) -> str:
        """The episode's name, see `Listed`."""
        return self.listed.name

    @property
    def group(self) -> str:
        """Name of the episode's scenario, or "source/clip" of a recording; see `Listed`."""
        return self.listed.group

    @property
    def label(self) -> str:
        """The episode's name for files, see `Listed`."""
        return self.listed.label

    @property
    def number(self) -> int:
        """Number of the episode within its scenario."""
        return self.listed.number

    @property
    def key(self) -> Key:
        """Numbers of scenario and episode, see `Listed`."""
        return self.listed.key

    @property
    def outcome(self) -> str:
        """The episode's outcome."""
        return self.listed.outcome

    @property
    def pedestrians(self) -> int:
        """Number of pedestrians."""
        return len(self.ped_x)

    @property
    def time(self) -> Floats:
        """Time since the first frame, float64[T] [s]."""
        return np.arange(len(self), dtype=np.float64) * self.period

    @property
    def vx(self) -> Floats:
        """Velocity of the vehicle to the east, float64[T] [m/s]."""
        return self.speed * np.cos(self.heading)

    @property
    def vy(self) -> Floats:
        """Velocity of the vehicle to the north, float64[T] [m/s]."""
        return self.speed * np.sin(self.heading)

    @property
    def path(self) -> Floats:
        """Distance that the vehicle has driven, float64[T] [m]."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(self.x), np.diff(self.y)))])

    @cached_property
    def known_curvttc(self) -> Floats:
        """CurvTTC, float64[n, T] [s], infinity where it was not computed."""
        return np.nan_to_num(self.curvttc, nan=np.inf, posinf=np.inf)

    @property
    def least_curvttc(self) -> float:
        """Least CurvTTC of all pedestrians [s], 0 in a collision; infinity where no contact was predicted."""
        return 0.0 if self.outcome == OUTCOME_NAMES[COLLISION] else float(self.known_curvttc.min())

    @cached_property
    def most_critical(self) -> int:
        """Index of the pedestrian with the least CurvTTC, the first of equal ones."""
        return int(self.known_curvttc.min(axis=1).argmin())

    def pair(self, pedestrian: int | None = None) -> "Episode":
        """Return the vehicle with one of the pedestrians alone; None: the most critical one."""
        i = self.most_critical if pedestrian is None else pedestrian
        own: dict[str, Any] = {name: getattr(self, name)[i : i + 1] for name in _OF_PEDESTRIANS}
        return replace(self, kinds=self.kinds[i : i + 1], **own)

    def pairs(self) -> list["Episode"]:
        """Return the vehicle with each of the pedestrians."""
        return [self.pair(i) for i in range(self.pedestrians)]

    def filled(self) -> "Episode":
        """Return the episode with missing motion replaced by the last known one; CurvTTC stays NaN."""
        motion: dict[str, Any] = {name: filled(getattr(self, name)) for name in _MOTION}
        return replace(self, **motion)

    def yielded(self) -> int:
        """Return who gave way to whom, vehicle and most critical pedestrian, as a code of `Yielded`."""
        return int(yields([self])[0])


def _first_known(values: NDArray[Any]) -> int:
    """Return the first frame in which any agent of values[n, T, 15] has a position; 0 if there is none."""
    return int((~np.isnan(values[..., [0, 4]])).any(axis=(0, 2)).argmax())


def batches(episodes: Iterable[Episode]) -> Iterator[list[Episode]]:
    """Yield episodes in lists of `BATCH`; the last list may be shorter."""
    left = iter(episodes)
    while batch := list(itertools.islice(left, BATCH)):
        yield batch


def yields(episodes: Iterable[Episode]) -> NDArray[np.uint8]:
    """Return who gave way in each episode, vehicle and most critical pedestrian, uint8[N], codes of `Yielded`.

    :param episodes: with vehicles of one size, at one period; an unobserved frame counts as the last observed one.
    """
    return np.concatenate([np.zeros(0, np.uint8), *(_yields(batch) for batch in batches(episodes))])


def _yields(episodes: Sequence[Episode]) -> NDArray[np.uint8]:
    first = episodes[0]
    pairs = [episode.pair().filled() for episode in episodes]
    vehicle = [[getattr(pair, name) for pair in pairs] for name in ("x", "y", "heading", "speed")]
    walk = [[getattr(pair, name)[0] for pair in pairs] for name in ("ped_x", "ped_y", "ped_vx", "ped_vy")]
    x, y, heading, speed, *others = (padded(rows) for rows in (*vehicle, *walk))
    px, py, vx, vy = others
    return who_yielded(
        *(x, y, heading, speed, px, py, vx, vy, padded([pair.known_curvttc[0] for pair in pairs], np.inf)),
        dt=first.period,
        lengths=[len(pair) for pair in pairs],
        length=first.length,
        width=first.width,
        radius=first.radius,
    )


def padded(rows: Sequence[NDArray[np.float64]], fill: float = 0.0) -> Floats:
    """Return series float64[T_i] of different lengths as float64[N, T], T the longest, with `fill` beyond each."""
    out = np.full((len(rows), max(map(len, rows))), fill)
    for row, values in zip(out, rows, strict=True):
        row[: len(values)] = values
    return out
