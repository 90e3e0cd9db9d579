"""Protocol A: simulators and recordings from the same recorded onsets, scored beside controls.

Both agents set out from the first step at which CurvTTC, as known then, is below 5 s, with up to a second of history,
and run for 3 s. `CONTROLS` names the controls. In `fading_acceleration` and `residual_sampler`, the fair ones, the
acceleration at the onset continues, as recorded acceleration does.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import Onsets
from vpsci_ros.evaluation.roll_out_scores import energy_score, errors
from vpsci_ros.evaluation.simulators import DONORS, Simulator, fading, residual_sampler, tracked
from vpsci_ros.evaluation.statistics import cluster_counts, interval
from vpsci_ros.extras.paper.min_ade import min_ade
from vpsci_ros.extras.paper.realism.controls import APART, CONTROL, FADING, FORCE, SAMPLER, TURN, constant_turn
from vpsci_ros.extras.paper.realism.features import features, with_borrowed_noise
from vpsci_ros.extras.paper.realism.likelihood import likelihoods
from vpsci_ros.extras.paper.realism.order import least_clearance
from vpsci_ros.extras.paper.realism.two_sample import FAMILIES, REPETITIONS, family, two_sample
from vpsci_ros.extras.paper.rule_based import rule_based

DRAWS = 2  # of the roll-outs of each onset that the classifier sees in a repetition
FAMILY_REPETITIONS = 1

Floats = NDArray[np.float64]


class SameStart:
    """Measures simulators one by one on the same onsets.

    :param onsets: those to be scored on; library: those whose residuals the sampler borrows, of other clips. Where it
        lacks a source that is scored, the noise of measurement comes from the scored clips: it is the camera's.
    :param seed: of the classifier and its draws, and of the resampling of units.
    :param repetitions: of the classifier's test; of the families of features, `FAMILY_REPETITIONS` at most.
    :ivar units: what intervals resample, and what the classifier's folds hold out.
    """

    def __init__(self, onsets: Onsets, library: Onsets, seed: int, repetitions: int = REPETITIONS) -> None:
        self.onsets, self._library, self._seed, self._repetitions = onsets, library, seed, repetitions
        self.missing = sorted(set(onsets.source) - set(library.source))
        self._noise = onsets if self.missing else library
        self._middle = tracked(onsets)
        self._turn = constant_turn(onsets, library, self._middle)
        self.units = onsets.units
        self._draws = cluster_counts(self.units.labels, seed)
        own = features(onsets.recorded[:, None], onsets)
        self._real = {name: value[:, 0] for name, value in own.items()}
        scored = {"constant_velocity": self._middle, TURN: self._turn}
        scored |= {FADING: fading(onsets), SAMPLER: self.sampler(onsets)}
        self._energies = {name: energy_score(own, onsets.recorded) for name, own in scored.items()}

    def controls(self) -> dict[str, Simulator]:
        """Return the simulators that are always measured, by name; the recording itself is the first."""
        return {
            "recorded": lambda onsets: onsets.recorded[:, None],
            CONTROL: lambda onsets: self._middle,
            TURN: lambda onsets: self._turn,
            FADING: fading,
            FORCE: rule_based,
            SAMPLER: self.sampler,
            APART: self._apart,
        }

    def sampler(self, onsets: Onsets, count: int = DONORS) -> Floats:
        """Return the roll-outs of the fair control, float64[n, K, 2, 30, 2] [m], by `count` donors."""
        library = replace(self._library, late=onsets.late)
        return residual_sampler(onsets, library, fading(onsets), fading(library), count)

    def _apart(self, onsets: Onsets) -> Floats:
        """Return the sampler's roll-outs by the nearest donors that lead to no contact, of eight times as many.

        Where these are fewer than the sampler's, the nearest of the others follow.
        """
        positions = self.sampler(onsets, 8 * DONORS)
        touches = least_clearance(positions, onsets) <= 0.0
        kept = np.argsort(touches, axis=1, kind="stable")[:, :DONORS]
        return np.take_along_axis(positions, kept[..., None, None, None], axis=1)

    def measure(
        self, positions: Floats, late: Floats | None = None, tell: Callable[[int], None] = lambda _: None
    ) -> dict[str, Any]:
        """Return the measures of roll-outs, float64[n, K, 2, 30, 2] [m], as JSON values with 95% intervals by `units`.

        The recording itself, given as roll-outs, shows how far the classifier separates by the borrowed noise alone.

        :param late: roll-outs with accelerations as a sensor has them (`Onsets.late`), float64[n, K, 2, 30, 2] [m]; the
            result then has their energy score and ADE as `late`.
        :param tell: called with 1, 2, .. before the test of each of `FAMILIES`.
        """
        onsets = self.onsets
        likely = likelihoods(positions, onsets)
        touched = (least_clearance(positions, onsets) <= 0.0).mean(axis=1)
        made = [self._seen(positions, self._seed + k) for k in range(self._repetitions)]
        units, families = (self.units.labels, self.units.labels), min(FAMILY_REPETITIONS, self._repetitions)
        tests = {}
        for done, name in enumerate(FAMILIES, start=1):
            tell(done)
            tests[name] = two_sample(
                family(self._real, name),
                [family(one, name) for one in made],
                units,
                self._seed,
                repetitions=self._repetitions if name == "all" else families,
            )
        first = tests["all"]
        return {
            "roll_outs": positions.shape[1],
            **self._errors(positions),
            **({} if late is None else {"late": self._errors(late)}),
            "min_ade_6": float(min_ade(positions, onsets.recorded).mean()),
            "likelihood": float(likely["all"].mean()),
            "likelihood_interval": self._mean(likely["all"]),
            "likelihood_of": {name: float(value.mean()) for name, value in likely.items() if name != "all"},
            "c2st_auc": first.auc,
            "c2st_auc_interval": list(first.auc_interval),
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

    def _errors(self, positions: Floats) -> dict[str, Any]:
        """Return energy score and ADE, and the score as a share of each control's, the ADE as one of `FADING`'s."""
        scores, ades = (
            energy_score(positions, self.onsets.recorded),
            errors(positions, self.onsets.recorded).mean(axis=1),
        )
        out: dict[str, Any] = {
            "energy_score": float(scores.mean()),
            "energy_score_interval": self._mean(scores),
            "ade": float(ades.mean()),
        }
        shares = {f"of_{name}": (scores, control) for name, control in self._energies.items()}
        for name, (own, control) in (shares | {f"ade_of_{FADING}": (ades, self._energies[FADING])}).items():
            out[name] = float(own.mean() / control.mean())
            out[f"{name}_interval"] = list(interval((self._draws @ own) / (self._draws @ control)))
        return out

    def _mean(self, values: Floats) -> list[float]:
        return list(interval(self._draws @ values / self._draws.sum(axis=1)))
