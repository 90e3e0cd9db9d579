"""The clips of a Turing test: recorded scenes, each continued as recorded and by two simulators.

The two are the policies and, in the place of CARLA's default controller, the rule-based pair: a vehicle that goes on
turning as it did and brakes fully for whoever is near and straight ahead, and a pedestrian who does not react.

All clips of a scene share the second before the onset (the first step with CurvTTC below 5 s), and then go their own
ways for 3 s. What would give away a source rather than its behaviour is the same for all: 0.1 s a frame, 4 s, the same
smoothing, footprints of one size, no map, and for each scene one rotation and one mirroring, drawn by the seed.
"""

from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.near_misses import clean
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.onsets import HISTORY, STEPS, Onsets, find_onsets
from vpsci_ros.evaluation.predictors import predictor_of
from vpsci_ros.evaluation.protocols import closed_loop_trajectories
from vpsci_ros.extras.paper.rule_based import rule_based
from vpsci_ros.policy.policy_file import Policy

Floats = NDArray[np.float64]
RECORDED, GENERATED, CONTROL = "recorded", "generated", "rule_based"
SOURCES = (RECORDED, GENERATED, CONTROL)
FRAMES = HISTORY + 1 + STEPS
_HALF_WINDOW = 3  # steps to either side over which positions are smoothed
_STILL = 0.02  # [m] a step shorter than this does not turn the vehicle


@dataclass(frozen=True)
class RatedClip:
    """One clip that raters classify.

    :ivar name: says nothing of the source.
    :ivar scene: which clips begin alike.
    :ivar source: one of `SOURCES`.
    :ivar values: float64[41, 5]: vehicle x, y [m], heading [rad], pedestrian x, y [m], every 0.1 s.
    """

    name: str
    scene: int
    source: str
    values: Floats


def draw_scenes(table: pl.DataFrame, count: int, seed: int) -> Onsets:
    """Return recorded onsets with a whole second before them, from as many recordings as possible.

    Standing cars, tracks that begin critical and paths that stay apart are left out.

    :raises InvalidInput: there are fewer than `count`.
    """
    onsets = find_onsets(clean(table), history=HISTORY)
    if len(onsets) < count:
        raise InvalidInput(
            f"near misses: expected {count} scenes of a driving car with 1 s before the onset and 3 s after it, found "
            f"{len(onsets)}; ask for fewer, or import more recordings"
        )
    order = np.random.default_rng([seed, 1]).permutation(len(onsets))
    turns: dict[str, int] = {}
    rank = np.zeros(len(onsets), np.int64)
    for row in order:  # the first of every recording comes before the second of any
        clip = str(onsets.clip[row])
        rank[row] = turns[clip] = turns.get(clip, -1) + 1
    chosen = order[np.argsort(rank[order], kind="stable")][:count]
    return onsets.take(np.sort(chosen))


def make_clips(onsets: Onsets, policy: Policy, seed: int) -> list[RatedClip]:
    """Return three clips for each scene, named and ordered at random."""
    steps = onsets.interactions.first[:, None] + np.arange(-HISTORY, 1)
    history = onsets.interactions.motion[np.arange(len(onsets))[:, None], steps]
    before = np.stack([history[..., 0:2], history[..., 5:7]], axis=1)
    predicted = closed_loop_trajectories(predictor_of(policy, onsets.clip, seed), onsets.interactions)
    after = {
        RECORDED: onsets.recorded,
        GENERATED: np.stack([predicted[..., 0:2], predicted[..., 5:7]], axis=1),
        CONTROL: rule_based(onsets, reacting=False, turning=True)[:, 0],
    }
    rng = np.random.default_rng([seed, 2])
    turn, mirror = rng.uniform(-np.pi, np.pi, len(onsets)), rng.integers(0, 2, len(onsets)) * 2 - 1
    names = [f"c{number:06x}" for number in rng.choice(1 << 24, 3 * len(onsets), replace=False)]
    clips: list[RatedClip] = []
    for scene in range(len(onsets)):
        for source in SOURCES:
            places = np.concatenate([before[scene], after[source][scene]], axis=1)
            smooth = equalised(places, float(history[scene, 0, 2]))
            values = _placed(smooth, float(turn[scene]), int(mirror[scene]))
            clips.append(RatedClip(names[len(clips)], scene, source, values))
    return [clips[row] for row in rng.permutation(len(clips))]


def equalised(places: Floats, heading: float) -> Floats:
    """Return a clip's motion, float64[T, 5], with the same smoothing for all sources.

    Positions are those of a least-squares parabola over 0.7 s; the vehicle's heading is the direction in which these
    move, and stays while they hardly do.

    :param places: float64[2, T, 2], vehicle and pedestrian [m].
    :param heading: of the vehicle [rad], where it stands from the beginning.
    """
    smooth = np.stack([_parabola(agent) for agent in places])
    vehicle = smooth[0]
    headings = np.empty(len(vehicle))
    for k in range(len(vehicle)):
        step = vehicle[min(k + 1, len(vehicle) - 1)] - vehicle[max(k - 1, 0)]
        if np.hypot(*step) > 2.0 * _STILL:
            heading += _wrapped(np.arctan2(step[1], step[0]) - heading)
        headings[k] = heading
    return np.column_stack([vehicle, headings, smooth[1]])


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _parabola(track: Floats) -> Floats:
    out = np.empty_like(track)
    for k in range(len(track)):
        steps = np.arange(max(0, k - _HALF_WINDOW), min(len(track), k + _HALF_WINDOW + 1))
        terms = np.vander(steps - k, 3, increasing=True).astype(np.float64)
        out[k] = np.linalg.lstsq(terms, track[steps], rcond=None)[0][0]
    return out


def _placed(values: Floats, turn: float, mirror: int) -> Floats:
    """Return motion turned and mirrored about the place of the vehicle at the onset."""
    out = values.copy()
    middle = values[HISTORY, 0:2]
    c, s = np.cos(turn), np.sin(turn)
    for columns in ((0, 1), (3, 4)):
        place = values[:, columns] - middle
        place[:, 1] *= mirror
        out[:, columns] = place @ np.array([[c, s], [-s, c]])
    out[:, 2] = mirror * values[:, 2] + turn
    return out
