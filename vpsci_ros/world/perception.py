"""The pedestrians as a driving system perceives them: a sensor with a view, and a tracker with its errors.

The sensor has a field of view and a range, and with `least_visible` detects nobody behind parked vehicles. The tracker
misses detections, has errors of position and velocity that are correlated in time (a Gauss-Markov process of first
order), loses tracks, and publishes its objects late. Every error is off by default, and parked vehicles hide nobody.

`perceive` is a pure function of its memory and the state, row by row: a row is a vehicle and one of its pedestrians,
and with P pedestrians an episode takes P consecutive rows. Errors are drawn from the counter-based generator, by seed,
scenario, episode, frame and pedestrian, so that an episode is perceived alike in every batch, and again from its bag.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import uint64
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import constant, parameter
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_PERCEPTION, draw, normal_pair, unit
from vpsci_ros.world.parked import EYE_FORWARD, Parked, visible
from vpsci_ros.world.state import EPISODE, IDLE

ABSENT, SEEN, OUT_OF_VIEW, HIDDEN, MISSED, LOST = 0, 1, 2, 3, 4, 5  # how it is with a pedestrian at a frame

OBJECT = np.dtype(
    [
        ("x", "f8"),  # [m] in the map, centre of the pedestrian as it is taken to be
        ("y", "f8"),
        ("vx", "f8"),  # [m/s]
        ("vy", "f8"),
        ("track", "u4"),  # number of the track within the episode, from 1; 0: none
        ("status", "u1"),  # SEEN, or why not
    ],
    align=True,
)

_TRACKER = np.dtype(
    [
        ("noise", "f8", (4,)),  # [m], [m/s] in x, y, vx, vy
        ("frame", "i8"),  # the last one, -2 before the first
        ("episode", "u4"),
        ("lost", "u4"),  # frames for which the track stays lost
        ("track", "u4"),  # 0: none
        ("tracks", "u4"),  # that the episode has had, in its first row
        ("scenario", "u1"),
    ],
    align=True,
)


@dataclass(frozen=True)
class PerceptionConfig:
    """The view of the sensor and the errors of the tracker; by default there are no errors."""

    seed: int = constant(1, "seed of the errors", low=0, high=2**63 - 1)
    field_of_view: float = parameter(
        360.0, "total angle of view, centred straight ahead", unit="degrees", low=1.0, high=360.0
    )
    reach: float = parameter(0.0, "range of the sensor; 0: unlimited", unit="m", low=0.0, high=1000.0)
    least_visible: float = parameter(
        0.0, "visible share below which parked vehicles hide a pedestrian; 0: never", low=0.0, high=1.0
    )
    position_noise: float = parameter(
        0.0, "standard deviation of the error of x, and of y", unit="m", low=0.0, high=10.0
    )
    velocity_noise: float = parameter(
        0.0, "standard deviation of the error of vx, and of vy", unit="m/s", low=0.0, high=10.0
    )
    noise_time: float = constant(1.0, "correlation time of the noise; 0: none", unit="s", low=0.0, high=60.0)
    missed: float = parameter(0.0, "share of frames in which a visible pedestrian is not detected", low=0.0, high=1.0)
    latency: float = parameter(
        0.0, "delay of objects, rounded to ticks; the stamp is the time of detection", unit="s", low=0.0, high=2.0
    )
    lost_rate: float = parameter(0.0, "rate at which the track of a pedestrian is lost", unit="1/s", low=0.0, high=10.0)
    lost_time: float = constant(0.5, "time until a lost pedestrian is found again", unit="s", low=0.05, high=60.0)

    def delay(self, period: float) -> int:
        """Return the latency in ticks of `period` seconds."""
        return round(self.latency / period)


class PerceptionState(NamedTuple):
    """Memory of perception from one frame to the next, for R rows."""

    trackers: NDArray[np.void]  # [R]
    late: NDArray[np.void]  # OBJECT[L, R] not published yet, the oldest first


class _Settings(NamedTuple):
    """`PerceptionConfig` for compiled code, per tick."""

    seed: np.uint64
    all_round: bool
    least_cosine: float  # of the angle between straight ahead and the pedestrian
    reach: float  # [m]
    least_visible: float
    position_noise: float  # [m]
    velocity_noise: float  # [m/s]
    kept: float  # of the noise, from one tick to the next
    fresh: float  # share of a standard deviation that is drawn again
    missed: float
    lost: float  # probability in a tick
    lost_frames: int


def blank(rows: int, config: PerceptionConfig, period: float) -> PerceptionState:
    """Return the initial memory of perception for `rows` rows, at ticks of `period` seconds."""
    trackers = np.zeros(rows, _TRACKER)
    trackers["frame"] = -2
    return PerceptionState(trackers, np.zeros((config.delay(period), rows), OBJECT))


def perceive(
    memory: PerceptionState,
    state: NDArray[np.void],
    config: PerceptionConfig,
    period: float,
    parked: Parked | None = None,
    pedestrians: int = 1,
) -> tuple[PerceptionState, NDArray[np.void]]:
    """Return the memory for the next frame and the objects published at this one, OBJECT[R].

    After a missing frame, an episode's tracks begin anew.

    :param state: EPISODE[R], `pedestrians` rows for each episode.
    :param period: of a tick [s].
    :param parked: vehicles that hide, see `vpsci_ros.world.parked.parked_from`.
    :raises InvalidInput: another number of rows than `memory` is for, or no whole number of episodes.
    """
    if len(state) != len(memory.trackers) or len(state) % pedestrians:
        raise InvalidInput(
            f"perceive: expected {len(memory.trackers)} rows, {pedestrians} for each episode, got {len(state)}"
        )
    trackers, now = memory.trackers.copy(), np.zeros(len(state), OBJECT)
    share = visible(state, parked)
    begun = np.zeros(len(state), np.bool_)
    _perceive(state, share, begun, _settings(config, period), pedestrians, trackers, now)
    if not len(memory.late):
        return PerceptionState(trackers, memory.late), now
    late = np.empty((len(memory.late) + 1, len(state)), OBJECT)
    late[:-1], late[-1] = memory.late, now
    if np.count_nonzero(begun):
        late[:-1, begun] = np.zeros((), OBJECT)
    return PerceptionState(trackers, late[1:]), late[0]


def warm_up(config: PerceptionConfig) -> None:
    """Compile `perceive`, or load it, so that no tick waits for compilation."""
    perceive(blank(1, config, 1.0), np.zeros(1, EPISODE), config, 1.0)


@lru_cache
def _settings(config: PerceptionConfig, period: float) -> _Settings:
    kept = math.exp(-period / config.noise_time) if config.noise_time > 0.0 else 0.0
    return _Settings(
        seed=np.uint64(config.seed),
        all_round=config.field_of_view >= 360.0,
        least_cosine=math.cos(math.radians(0.5 * config.field_of_view)),
        reach=config.reach or math.inf,
        least_visible=config.least_visible,
        position_noise=config.position_noise,
        velocity_noise=config.velocity_noise,
        kept=kept,
        fresh=math.sqrt(1.0 - kept * kept),
        missed=config.missed,
        lost=1.0 - math.exp(-config.lost_rate * period),
        lost_frames=max(1, round(config.lost_time / period)),
    )


@kernel
def _perceive(state, share, begun, settings, pedestrians, trackers, objects):  # type: ignore[no-untyped-def]
    for first in range(0, state.size, pedestrians):
        for i in range(first, first + pedestrians):
            begun[i] = _begins(state[i], trackers[i])
            _follow(state[i], share[i], begun[i], settings, trackers[i], objects[i])
        if begun[first]:
            trackers[first].tracks = 0
        for i in range(first, first + pedestrians):
            if objects[i].status == SEEN and trackers[i].track == 0:
                trackers[first].tracks += 1
                trackers[i].track = trackers[first].tracks
        for i in range(first, first + pedestrians):
            objects[i].track = trackers[i].track if objects[i].status == SEEN else 0


@kernel
def _begins(episode, tracker):  # type: ignore[no-untyped-def]
    """Return whether the tracker does not know this episode's frame before: a new episode, a missing frame, idle."""
    same = episode.scenario == tracker.scenario and episode.episode == tracker.episode
    return not (same and episode.frame == tracker.frame + 1 and episode.status != IDLE)


@kernel
def _follow(episode, share, begun, settings, tracker, found):  # type: ignore[no-untyped-def]
    """Follow one pedestrian for a frame: its noise goes on whether or not it is seen."""
    tracker.scenario, tracker.episode, tracker.frame = episode.scenario, episode.episode, episode.frame
    if begun:
        tracker.track, tracker.lost = 0, 0
    if episode.status == IDLE:
        tracker.frame = -2
        found.status = ABSENT
        return
    first, second = _draws(episode, settings.seed, 0), _draws(episode, settings.seed, 1)
    one, other = normal_pair(unit(first[0]), unit(first[1]))
    third, fourth = normal_pair(unit(first[2]), unit(first[3]))
    kept, fresh = (0.0, 1.0) if begun else (settings.kept, settings.fresh)
    tracker.noise[0] = kept * tracker.noise[0] + fresh * settings.position_noise * one
    tracker.noise[1] = kept * tracker.noise[1] + fresh * settings.position_noise * other
    tracker.noise[2] = kept * tracker.noise[2] + fresh * settings.velocity_noise * third
    tracker.noise[3] = kept * tracker.noise[3] + fresh * settings.velocity_noise * fourth
    found.status = _sight(episode, share, settings)
    if tracker.lost > 0:
        tracker.lost -= 1
    elif tracker.track > 0 and unit(second[1]) < settings.lost:
        tracker.lost = settings.lost_frames
    if found.status == SEEN and tracker.lost > 0:
        found.status = LOST
    if found.status != SEEN:
        tracker.track = 0
    elif unit(second[0]) < settings.missed:
        found.status = MISSED
    if found.status == SEEN:
        found.x, found.y = episode.pedestrian_x + tracker.noise[0], episode.pedestrian_y + tracker.noise[1]
        found.vx, found.vy = episode.pedestrian_vx + tracker.noise[2], episode.pedestrian_vy + tracker.noise[3]


@kernel
def _sight(episode, share, settings):  # type: ignore[no-untyped-def]
    """Return SEEN, OUT_OF_VIEW or HIDDEN."""
    c, s = math.cos(episode.vehicle_heading), math.sin(episode.vehicle_heading)
    dx = episode.pedestrian_x - episode.vehicle_x - EYE_FORWARD * c
    dy = episode.pedestrian_y - episode.vehicle_y - EYE_FORWARD * s
    distance = math.sqrt(dx * dx + dy * dy)
    ahead = settings.all_round or c * dx + s * dy >= settings.least_cosine * distance
    if not ahead or distance > settings.reach:
        return OUT_OF_VIEW
    return HIDDEN if share < settings.least_visible else SEEN


@kernel
def _draws(episode, seed, block):  # type: ignore[no-untyped-def]
    return draw(episode, seed, uint64(STREAM_PERCEPTION) + (uint64(episode.frame) << uint64(8)), block)
