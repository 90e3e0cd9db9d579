"""Simulators beside the residual sampler: who goes first, the other agent's recording in front, and answers to it.

Intervals are 95%, of clips or groups resampled, and paired where they are of a difference.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import Onsets
from vpsci_ros.evaluation.simulators import Simulator, tracked
from vpsci_ros.evaluation.statistics import cluster_counts
from vpsci_ros.extras.paper.realism.forecasts import forecasts
from vpsci_ros.extras.paper.realism.in_front import COMPARED, EXCHANGES, Answer, answers, front, recorded_answers
from vpsci_ros.extras.paper.realism.order import Scores, beside, difference, estimate, scores
from vpsci_ros.world.observation import AGENTS

BOTH = "both"  # agents act; else the name of the one that acts in front of the other one's recording
VIEWS = (BOTH, *reversed(AGENTS))

Floats = NDArray[np.float64]


class BesideSampler:
    """Measures simulators one by one on the same onsets.

    :param sampler: the control with which they are paired; library: onsets of the forecasts and recorded answers.
    :param seed: of the resampling, and of the folds of the regression.
    """

    def __init__(self, onsets: Onsets, library: Onsets, sampler: Simulator, seed: int) -> None:
        self._onsets, self._library, self._seed = onsets, library, seed
        self._draws = cluster_counts(onsets.units.labels, seed)
        self._control = dict(self._scores(onsets, tracked, tracked(onsets)))
        views = {late: replace(onsets, late=late) for late in (False, True)}
        self._sampler = {late: dict(self._scores(view, sampler, sampler(view))) for late, view in views.items()}

    def measure(self, simulate: Simulator, positions: Floats, late: Floats) -> dict[str, Any]:
        """Return {VIEW: SCORES, "answers": {AGENT: ..}, "late": the same with accelerations known late}.

        VIEW is "both", or the agent that acts in front of the other one's recording; SCORES are those of `order.beside`
        as [mean, low, high], and `off` is that of `in_front.front`: [mean, largest].

        :param positions, late: its roll-outs, where accelerations are those recorded, and known late.
        """
        return self._measured(simulate, positions, False) | {"late": self._measured(simulate, late, True)}

    def forecasts(self) -> dict[str, Any]:
        """Return name -> {VIEW: {"brier": .., "brier_minus_sampler": ..}, "late": ..} of `forecasts.forecasts`."""
        first = self._onsets.pedestrian_first
        out: dict[str, dict[str, Any]] = {}
        for late in (False, True):
            onsets, library = (replace(own, late=late) for own in (self._onsets, self._library))
            for name, share in forecasts(onsets, library, self._seed).items():
                own = {"brier": (share - first) ** 2}
                made: dict[str, Any] = {view: self._beside(view, own, late) for view in VIEWS}
                out[name] = out[name] | {"late": made} if late else made
        return out

    def recorded_answers(self) -> dict[str, Any]:
        """Return the `recorded_answers` of the library's onsets, with the number of onsets `n` of each exchange."""
        draws = cluster_counts(self._library.units.labels, self._seed)
        out = {}
        for agent in AGENTS:
            own = recorded_answers(self._library, agent)
            out[agent] = _answers(own, agent, draws)
            for name, answer in own.items():
                out[agent][name]["n"] = int((~np.isnan(answer["slower"])).sum())
        return out

    def _scores(self, onsets: Onsets, simulate: Simulator, positions: Floats) -> Iterator[tuple[str, Scores]]:
        yield BOTH, scores(positions, onsets)
        for agent in VIEWS[1:]:
            yield agent, front(onsets, simulate, agent)

    def _beside(self, view: str, own: Scores, late: bool) -> dict[str, list[float]]:
        return beside(own, self._sampler[late][view], self._control[view], self._draws)

    def _measured(self, simulate: Simulator, positions: Floats, late: bool) -> dict[str, Any]:
        onsets = replace(self._onsets, late=late)
        out: dict[str, Any] = {}
        for view, own in self._scores(onsets, simulate, positions):
            off = own.pop("off", None)
            out[view] = self._beside(view, own, late)
            if off is not None:
                out[view]["off"] = [float(off.mean()), float(off.max())]
        out["answers"] = {a: _answers(answers(onsets, simulate, a), a, self._draws) for a in AGENTS}
        return out


def _answers(own: dict[str, Answer], agent: str, draws: Floats) -> dict[str, Any]:
    """Return exchange -> `slower` and `change`, [mean, low, high] each, and as `difference` those of `COMPARED`."""
    out: dict[str, Any] = {
        name: {key: estimate(value, draws) for key, value in own[name].items()} for name in EXCHANGES[agent]
    }
    first, second = (own[name] for name in COMPARED[agent])
    out["difference"] = {key: difference(first[key], second[key], draws) for key in first}
    return out
