"""Protocol A: simulators and recordings from the same recorded onsets, scored beside controls.

Both agents set out from the first step at which CurvTTC, as known then, is below 5 s, with up to a second of history,
and run for 3 s. `constant_velocity_tracked`, `constant_turn`, `social_force` and `residual_sampler` are the controls.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import STEPS, Onsets, borrowable, energy_score, errors, min_ade
from vpsci_ros.evaluation.simulators import Simulator, rule_based, tracked
from vpsci_ros.evaluation.statistics import cluster_counts, interval
from vpsci_ros.extras.paper.realism.features import features, motion, with_borrowed_noise, with_onset
from vpsci_ros.extras.paper.realism.likelihood import likelihoods
from vpsci_ros.extras.paper.realism.two_sample import FAMILIES, REPETITIONS, family, two_sample
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]


# ---- Simulators that learn nothing, the controls: constant velocity, the mean turn, residuals of people at near
# onsets.
#
# Each answers onsets with positions float64[n, K, 2, 30, 2] [m] in the map frame.


NEAREST = 32  # onsets of other clips whose residuals are borrowed


def constant_velocity(onsets: Onsets, velocity: Floats | None = None) -> Floats:
    """Return where both agents come at the velocity of the onset, K = 1.

    :param velocity: of the vehicle, float64[n, 2] [m/s]; None: as recorded.
    """
    start = onsets.start
    time = STEP * np.arange(1, STEPS + 1)[None, :, None]
    driven = start[:, 3:5] if velocity is None else velocity
    places = [start[:, None, 0:2] + driven[:, None] * time, start[:, None, 5:7] + start[:, None, 7:9] * time]
    return np.stack(places, axis=1)[:, None]


def constant_turn(onsets: Onsets, library: Onsets, middle: Floats) -> Floats:
    """Return where a vehicle comes with the curvature and the change of speed that others have on average, K = 1.

    Both are means over the 3 s after the library's onsets, of those in `borrowable`: one bend, one deceleration for all
    of a source. The pedestrian keeps its velocity.

    :param middle: constant velocity, float64[n, 1, 2, 30, 2], whose beginning and pedestrian this has.
    """
    moved, row, first = library.interactions.motion, np.arange(len(library)), library.interactions.first
    begin, end = moved[row, first], moved[row, first + STEPS]
    places = np.concatenate([begin[:, None, :2], library.recorded[:, 0]], axis=1)
    way = np.linalg.norm(np.diff(places, axis=1), axis=2).sum(axis=1)
    gain = (np.hypot(end[:, 3], end[:, 4]) - np.hypot(begin[:, 3], begin[:, 4])) / (STEPS * STEP)
    others = borrowable(onsets, library).astype(np.float64)
    curvature = (others @ (end[:, 2] - begin[:, 2])) / np.maximum(others @ way, 1e-9)
    mean_gain = (others @ gain) / others.sum(axis=1)
    step = middle[:, 0, 0, 0] - onsets.start[:, :2]
    speed = np.hypot(step[:, 0], step[:, 1]) / STEP
    speeds = np.maximum(speed[:, None] + mean_gain[:, None] * STEP * (np.arange(STEPS) + 0.5), 0.0)
    heading = np.where(speed > 0.1, np.arctan2(step[:, 1], step[:, 0]), onsets.start[:, 2])
    angle = heading[:, None] + curvature[:, None] * STEP * (np.cumsum(speeds, axis=1) - 0.5 * speeds)
    out = middle.copy()
    driven = STEP * speeds[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    out[:, 0, 0] = onsets.start[:, None, :2] + np.cumsum(driven, axis=1)
    return out


def residual_sampler(onsets: Onsets, library: Onsets, middle: Floats, library_middle: Floats) -> Floats:
    """Return a middle trajectory with what other people, at the `NEAREST` most similar onsets, did beside theirs.

    A residual is the recording less its own middle trajectory: the vehicle's forward and left of its heading, the
    pedestrian's in the same frame. No residual comes from the own clip, nor of another source where the own one
    has others. K is 32, or as many as there are.

    :param middle: float64[n, 1, 2, 30, 2]; library_middle: the same of the library's onsets.
    """
    here, there = _similarity(onsets), _similarity(library)
    deviation = there.std(axis=0) + 1e-9
    apart = np.linalg.norm((here[:, None] - there[None]) / deviation, axis=2)
    apart[~borrowable(onsets, library)] = np.inf
    count = min(NEAREST, int(np.isfinite(apart).sum(axis=1).min()))
    nearest = np.argsort(apart, axis=1)[:, :count]
    turn = _rotation(library.start[:, 2])
    residual = np.einsum("nij,natj->nati", turn, library.recorded - library_middle[:, 0])
    back = _rotation(onsets.start[:, 2])
    chosen = residual[nearest]
    chosen[..., 1] *= (_side(onsets)[:, None] * _side(library)[nearest])[:, :, None, None]  # mirrored where they differ
    result: Floats = middle + np.einsum("nji,nkatj->nkati", back, chosen)
    return result


def _rotation(heading: Floats) -> Floats:
    """Return float64[n, 2, 2] that turn map vectors into (forward, left) of `heading`."""
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)


def _similarity(onsets: Onsets) -> Floats:
    """Return what makes two onsets similar, float64[n, 6]; on which side the pedestrian is does not."""
    start = onsets.start
    turn = _rotation(start[:, 2])
    place = np.einsum("nij,nj->ni", turn, start[:, 5:7] - start[:, 0:2])
    walk = np.einsum("nij,nj->ni", turn, start[:, 7:9])
    speed, pace = np.hypot(start[:, 3], start[:, 4]), np.hypot(walk[:, 0], walk[:, 1])
    side = _side(onsets)
    return np.stack([speed, pace, place[:, 0], place[:, 1] * side, walk[:, 0], walk[:, 1] * side], axis=1)


def _side(onsets: Onsets) -> Floats:
    """Return 1 where the pedestrian is to the left of the vehicle at the onset, else -1, float64[n]."""
    start = onsets.start
    east, north = start[:, 5] - start[:, 0], start[:, 6] - start[:, 1]
    return np.where(np.cos(start[:, 2]) * north - np.sin(start[:, 2]) * east < 0.0, -1.0, 1.0)


CONTROL = "constant_velocity_tracked"
TURN = "constant_turn"
CONTROLS = ("recorded", CONTROL, TURN, "social_force", "residual_sampler")
DRAWS = 2  # of the roll-outs of each onset that the classifier sees in a repetition
FAMILY_REPETITIONS = 3


class SameStart:
    """Measures simulators one by one on the same onsets.

    :param onsets: those to be scored on; library: those whose residuals the sampler borrows, of other clips. Where it
        lacks a source that is scored, the noise of measurement comes from the scored clips: it is the camera's.
    :param seed: of the classifier, of what is resampled, and of the resampling of clips.
    :param repetitions: of the classifier's test; of the families of features, `FAMILY_REPETITIONS` at most.
    """

    def __init__(self, onsets: Onsets, library: Onsets, seed: int, repetitions: int = REPETITIONS) -> None:
        self.onsets, self._library, self._seed, self._repetitions = onsets, library, seed, repetitions
        self.missing = sorted(set(onsets.source) - set(library.source))
        self._noise = onsets if self.missing else library
        self._middle = tracked(onsets)
        self._turn = constant_turn(onsets, library, self._middle)
        self._draws = cluster_counts(onsets.clip.astype(str), seed)
        own = features(onsets.recorded[:, None], onsets)
        self._real = {name: value[:, 0] for name, value in own.items()}
        middles = {"constant_velocity": self._middle, TURN: self._turn}
        self._energies = {name: energy_score(middle, onsets.recorded) for name, middle in middles.items()}
        self._ends = [likelihoods(p, onsets)["all"] for p in (self._middle, onsets.recorded[:, None])]

    def controls(self) -> dict[str, Simulator]:
        """Return the simulators that are always measured, by name; the recording itself is the first."""
        return {
            "recorded": lambda onsets: onsets.recorded[:, None],
            CONTROL: lambda onsets: self._middle,
            TURN: lambda onsets: self._turn,
            "social_force": rule_based,
            "residual_sampler": self._residuals,
        }

    def _residuals(self, onsets: Onsets) -> Floats:
        same = self._library is onsets
        return residual_sampler(
            onsets, self._library, self._middle, self._middle if same else tracked(self._library)
        )  # fmt: skip

    def measure(self, positions: Floats) -> dict[str, Any]:
        """Return the measures of roll-outs, float64[n, K, 2, 30, 2] [m], as JSON values with 95% intervals by clips.

        The recording itself, given as roll-outs, shows how far the classifier separates by the borrowed noise alone.
        """
        onsets = self.onsets
        scores, likely = energy_score(positions, onsets.recorded), likelihoods(positions, onsets)
        contact = motion(with_onset(positions, onsets.start), onsets.start, onsets.size).clearance <= 0.0
        touched = contact.any(axis=-1).mean(axis=1)
        made = [self._seen(positions, self._seed + k) for k in range(self._repetitions)]
        clips, families = (onsets.clip, onsets.clip), min(FAMILY_REPETITIONS, self._repetitions)
        tests = {
            name: two_sample(
                family(self._real, name),
                [family(one, name) for one in made],
                clips,
                self._seed,
                repetitions=self._repetitions if name == "all" else families,
            )
            for name in FAMILIES
        }
        first = tests["all"]
        low, high = (end.mean() for end in self._ends)
        return {
            "roll_outs": positions.shape[1],
            "energy_score": float(scores.mean()),
            "energy_score_interval": self._mean(scores),
            **self._of_controls(scores),
            "ade": float(errors(positions, onsets.recorded).mean()),
            "min_ade_6": float(min_ade(positions, onsets.recorded).mean()),
            "likelihood": float(likely["all"].mean()),
            "likelihood_interval": self._mean(likely["all"]),
            "likelihood_way": float((likely["all"].mean() - low) / (high - low)),
            "likelihood_of": {name: float(value.mean()) for name, value in likely.items() if name != "all"},
            "c2st_auc": first.auc,
            "c2st_auc_interval": list(first.auc_interval),
            "c2st_auc_spread": first.spread,
            "picked": first.picked,
            "c2st_auc_of": {name: [tests[name].auc, *tests[name].auc_interval] for name in FAMILIES[1:]},
            "given_away_by": first.importance,
            "collision_rate": float(touched.mean()),
            "collision_rate_interval": self._mean(touched),
        }

    def _seen(self, positions: Floats, seed: int) -> dict[str, Floats]:
        """Return what the classifier sees in one repetition: `DRAWS` roll-outs of each onset, with borrowed noise."""
        order = np.random.default_rng(seed).permuted(
            np.tile(np.arange(positions.shape[1]), (len(positions), 1)), axis=1
        )
        chosen = order[:, np.arange(DRAWS) % positions.shape[1], None, None, None]
        drawn = np.take_along_axis(positions, chosen, axis=1)
        return features(with_borrowed_noise(drawn, self.onsets, seed, self._noise), self.onsets)

    def _of_controls(self, scores: Floats) -> dict[str, Any]:
        out: dict[str, Any] = {}
        for name, control in self._energies.items():
            out[f"of_{name}"] = float(scores.mean() / control.mean())
            out[f"of_{name}_interval"] = list(interval((self._draws @ scores) / (self._draws @ control)))
        return out

    def _mean(self, values: Floats) -> list[float]:
        return list(interval(self._draws @ values / self._draws.sum(axis=1)))
