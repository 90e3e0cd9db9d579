"""A small made-up sample of near misses, for runs without real data; every row says source = "synthetic".

A car drives straight on or turns, a pedestrian crosses its path, and both would be at the crossing point at about the
same time. Some seconds before that one of them notices and yields, the other goes on or hurries. The reactions are
simple rules with the delays and decelerations that people show; they carry a demonstration, they are no evidence.
All motion is smooth, as the Kalman-filtered recordings are, and goes through the same pairing as theirs.
"""

from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.courses import filled, headings
from vpsci_ros.data.episode import QUANTITIES
from vpsci_ros.data.episode_block import JUDGED, EpisodeBlock
from vpsci_ros.data.importers import ImportResult
from vpsci_ros.data.importers.pairs import near_misses_of
from vpsci_ros.data.importers.tracks import Clip, Track
from vpsci_ros.data.near_misses import check_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.shapes import weight_shapes
from vpsci_ros.policy.weights import Weights
from vpsci_ros.world.observation import STEP
from vpsci_ros.world.state import GOAL

Floats = NDArray[np.float64]
SOURCE = "synthetic"
LENGTH, WIDTH = 4.5, 1.8  # [m] a car, as in VCI-DUT
DURATION = 12.0  # [s] of each encounter, before the quiet parts are cut off
_CROSSING = 40.0  # [m] along the car's path
_CANDIDATES = 4  # encounters made for each one wanted; what touches or is no near miss is left out
_LAG = 0.3  # [s] in which an acceleration follows what its agent wants


@dataclass(frozen=True)
class _Encounters:
    """Draws that make N encounters; every field is float64[N] unless noted."""

    radius_sign: Floats  # -1 right turn, 0 straight, 1 left turn
    radius: Floats  # [m] of the turn
    turn_at: Floats  # [m] along the path at which the turn begins
    speed: Floats  # [m/s] at which the car drives when nobody is near
    walk: Floats  # [m/s] at which the pedestrian walks
    side: Floats  # 1: the pedestrian comes from the right, -1: from the left
    slant: Floats  # [rad] by which it does not cross at a right angle
    arrival: Floats  # [s] at which the car would be at the crossing
    lead: Floats  # [s] by which the pedestrian would be there earlier
    vehicle_yields: Floats  # 1 or 0
    notice: Floats  # [s] before the car's arrival at which the yielding agent begins to react
    braking: Floats  # [m/s2] at which a yielding car slows down
    speed_up: Floats  # factor on its speed of a pedestrian who is let go
    stop_short: Floats  # [m] before the car's path at which a yielding pedestrian waits
    pose: Floats  # [N, 3] of the scene: x, y [m], rotation [rad]


def synthetic_near_misses(interactions: int = 60, seed: int = 0) -> ImportResult:
    """Return a near-miss table of `interactions` made-up encounters, each a clip of its own, and its summary.

    The same numbers give the same table, and a longer table begins with the rows of a shorter one.

    :raises InvalidInput: not 1 to 10,000 interactions, or a negative seed.
    """
    if not 1 <= interactions <= 10_000 or seed < 0:
        raise InvalidInput(f"expected 1 to 10000 interactions and a seed of 0 or more, got {interactions}, {seed}")
    candidates = (clip for n in range(interactions) for clip in _clips(_simulate(_draw(64 * _CANDIDATES, seed, n)), n))
    clips = list(islice(filter(_is_near_miss, candidates), interactions))  # to tell one takes hundredths of a second
    result = near_misses_of(SOURCE, clips, length=LENGTH, width=WIDTH)
    check_near_misses(result.table, SOURCE)
    return result


def _is_near_miss(clip: Clip) -> bool:
    table = near_misses_of(SOURCE, [clip], length=LENGTH, width=WIDTH).table
    least = table["curvttc"].min()
    return isinstance(least, float) and least > 0.1


def _draw(n: int, seed: int, block: int) -> _Encounters:
    rng = np.random.Generator(np.random.Philox(key=np.array([seed, block], np.uint64)))
    speed = rng.uniform(2.5, 6.5, n)
    walk = rng.uniform(0.9, 1.9, n)
    lead = rng.normal(0.0, 1.6, n)
    # Who yields: the later one, and more often the walker the faster the car is (Pu et al. 2026b).
    odds = 1.2 * lead - 0.7 * (speed - 4.0) + 2.0 * (walk - 1.4)
    return _Encounters(
        radius_sign=rng.choice([-1.0, -1.0, 0.0, 1.0], n),
        radius=rng.uniform(6.0, 12.0, n),
        turn_at=_CROSSING - rng.uniform(4.0, 14.0, n),
        speed=speed,
        walk=walk,
        side=rng.choice([-1.0, 1.0], n),
        slant=rng.normal(0.0, 0.15, n),
        arrival=rng.uniform(4.5, 5.5, n),
        lead=lead,
        vehicle_yields=(rng.random(n) < 1.0 / (1.0 + np.exp(-odds))).astype(np.float64),
        notice=rng.uniform(2.2, 8.0, n),
        braking=rng.uniform(0.8, 2.4, n),
        speed_up=rng.uniform(1.0, 1.45, n),
        stop_short=rng.uniform(1.5, 3.0, n),
        pose=np.column_stack([rng.uniform(-20.0, 20.0, (n, 2)), rng.uniform(-np.pi, np.pi, n)]),
    )


def _path(e: _Encounters) -> tuple[Floats, Floats]:
    """Return positions [N, S, 2] [m] and headings [N, S] [rad] along the cars' paths, 0.1 m apart."""
    s = np.arange(0.0, 110.0, 0.1)
    ramp = 3.0  # [m] in which the wheel is turned
    quarter = e.radius * np.pi / 2.0
    into = np.clip((s - e.turn_at[:, None]) / ramp, 0.0, 1.0)
    out = np.clip((s - (e.turn_at + quarter)[:, None]) / ramp, 0.0, 1.0)
    curvature = (e.radius_sign / e.radius)[:, None] * (_smooth(into) - _smooth(out))
    turned = curvature * 0.1
    heading = np.cumsum(turned, axis=1) - turned
    middle = heading + 0.5 * turned
    steps = np.stack([np.cos(middle), np.sin(middle)], axis=-1) * 0.1
    return np.cumsum(steps, axis=1) - steps, heading


def _smooth(x: Floats) -> Floats:
    result: Floats = x * x * (3.0 - 2.0 * x)
    return result


def _simulate(e: _Encounters) -> dict[str, Floats]:
    """Return vehicle x, y, heading, speed and pedestrian px, py, pvx, pvy as float64[N, T] on the 0.1 s grid."""
    n, steps = len(e.speed), round(DURATION / STEP) + 1
    path, headings = _path(e)
    rows, crossing = np.arange(n), round(_CROSSING / 0.1)
    across = headings[:, crossing] + e.side * (np.pi / 2.0 + e.slant)
    s, v, a = _CROSSING - e.speed * e.arrival, e.speed.copy(), np.zeros(n)
    q, w, b = -e.walk * (e.arrival - e.lead), e.walk.copy(), np.zeros(n)  # along the walker's line, 0 at the crossing
    out = {name: np.empty((n, steps)) for name in ("x", "y", "heading", "speed", "px", "py", "pvx", "pvy")}
    for k in range(steps):
        low = (s / 0.1).astype(np.int64)
        part = s / 0.1 - low
        here = path[rows, low] + part[:, None] * (path[rows, low + 1] - path[rows, low])
        out["heading"][:, k] = headings[rows, low] + part * (headings[rows, low + 1] - headings[rows, low])
        out["x"][:, k], out["y"][:, k], out["speed"][:, k] = here[:, 0], here[:, 1], v
        out["px"][:, k] = path[rows, crossing, 0] + q * np.cos(across)
        out["py"][:, k] = path[rows, crossing, 1] + q * np.sin(across)
        out["pvx"][:, k], out["pvy"][:, k] = w * np.cos(across), w * np.sin(across)
        a, b = _accelerations(e, k * STEP, s, v, a, q, w, b)
        s, v = s + STEP * np.maximum(v + 0.5 * STEP * a, 0.0), np.maximum(v + STEP * a, 0.0)
        q, w = q + STEP * np.maximum(w + 0.5 * STEP * b, 0.0), np.maximum(w + STEP * b, 0.0)
    return _placed(out, e.pose)


def _placed(motion: dict[str, Floats], pose: Floats) -> dict[str, Floats]:
    """Return the scenes, each made about its own crossing, turned and shifted into a map."""
    cos, sin = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
    shift = pose[:, :2, None]
    out = {"heading": motion["heading"] + pose[:, 2:], "speed": motion["speed"]}
    for x, y, fixed in (("x", "y", 1.0), ("px", "py", 1.0), ("pvx", "pvy", 0.0)):
        out[x] = cos * motion[x] - sin * motion[y] + fixed * shift[:, 0]
        out[y] = sin * motion[x] + cos * motion[y] + fixed * shift[:, 1]
    return out


def _accelerations(
    e: _Encounters, t: float, s: Floats, v: Floats, a: Floats, q: Floats, w: Floats, b: Floats
) -> tuple[Floats, Floats]:
    """Return both accelerations [m/s2] of the next step: each agent's wish, followed with a lag."""
    reacting = t > e.arrival - e.notice
    pedestrian_gone = q > 1.6
    vehicle_gone = s > _CROSSING + LENGTH / 2.0 + 0.8
    room = np.maximum(_CROSSING - 4.5 - s, 0.0)
    wait = reacting & (e.vehicle_yields > 0.0) & ~pedestrian_gone & (s < _CROSSING - 2.0)
    wish_v = np.where(wait, np.minimum(e.speed, np.sqrt(2.0 * e.braking * room)), e.speed)
    room = np.maximum(-e.stop_short - q, 0.0)
    wait = reacting & (e.vehicle_yields == 0.0) & ~vehicle_gone & (q < -0.9)
    going = np.where(reacting & (e.vehicle_yields > 0.0) & ~pedestrian_gone, e.walk * e.speed_up, e.walk)
    wish_w = np.where(wait, np.minimum(e.walk, np.sqrt(2.0 * 0.6 * room)), going)
    wanted_a = np.clip((wish_v - v) / 0.5, -6.0, 1.5)
    wanted_b = np.clip((wish_w - w) / 0.5, -2.5, 1.5)
    return a + (wanted_a - a) * STEP / _LAG, b + (wanted_b - b) * STEP / _LAG


def _clips(made: dict[str, Floats], block: int) -> list[Clip]:
    n = len(made["x"])
    clips = []
    for i in range(n):
        own = {name: values[i] for name, values in made.items()}
        vehicle = {name: own[name] for name in ("x", "y", "heading", "speed")}
        pedestrian = {name: own["p" + name] for name in ("x", "y", "vx", "vy")}
        clips.append(Clip(f"synthetic_{block * n + i:05d}", [Track(0, 0, vehicle)], [Track(0, 0, pedestrian)]))
    return clips


def random_weights(network: NetworkConfig, seed: int = 1) -> Weights:
    """Return weights of random numbers: policies that act, if not wisely."""
    rng = np.random.default_rng(seed)
    tensors = {name: rng.normal(0.0, 0.3, shape) for name, shape in weight_shapes(network).items()}
    tensors |= {name: 1.0 + np.abs(tensor) for name, tensor in tensors.items() if name.endswith("scale")}
    return Weights(network, {name: tensor.astype(np.float32) for name, tensor in tensors.items()})


def block_of_pairs(values: np.ndarray, scenario: int = 1) -> EpisodeBlock:
    """Return episodes 0, 1, ... of one pedestrian, float32[n, frames, 10 or 15], that ended at the goal.

    :param values: `QUANTITIES`; of the first ten alone, headings and speeds are those of the velocities.
    """
    if values.shape[2] < len(QUANTITIES):
        vx, vy = values[..., 2], values[..., 3]
        more = [headings(filled(vx), filled(vy)), np.hypot(vx, vy), 0.0 * vx, 0.0 * vx, np.ones_like(vx)]
        values = np.concatenate([values, np.stack(more, axis=-1)], axis=-1).astype(np.float32)
    records = np.zeros(len(values), JUDGED)
    records["scenario"], records["count"], records["outcome"] = scenario, np.arange(len(values)), GOAL
    records["frames"] = records["rows"] = values.shape[1]
    records["pedestrians"] = 1
    return EpisodeBlock(records, values.reshape(-1, values.shape[2]))
