"""Each row of Table 9 on held-out clips, pooled over folds, with intervals by `statistics.units_of`."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.corpus import table_hash
from vpsci_ros.data.interactions import Interactions
from vpsci_ros.documents import read_json
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.errors import ade_share, compare
from vpsci_ros.evaluation.onsets import Onsets, find_onsets
from vpsci_ros.evaluation.outcomes import measure_outcomes
from vpsci_ros.evaluation.predictors import PolicyPredictor
from vpsci_ros.evaluation.protocols import Measured, measure
from vpsci_ros.evaluation.simulators import rolled_out
from vpsci_ros.evaluation.statistics import cluster_counts, share, units_of
from vpsci_ros.extras.paper.realism.features import features, with_borrowed_noise
from vpsci_ros.extras.paper.realism.likelihood import likelihoods
from vpsci_ros.extras.paper.realism.order import Scores, estimate, scores
from vpsci_ros.extras.paper.realism.two_sample import two_sample
from vpsci_ros.extras.paper.studies.folds import pooled
from vpsci_ros.extras.paper.studies.state import once
from vpsci_ros.learning.training_config import RefineConfig
from vpsci_ros.parameters import values_of
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.policy.weights import Weights, load_weights
from vpsci_ros.world import COLLISION, GOAL

REFERENCE, COST = "ma_sst_ddpg", "cost.json"
_TIMED = 20  # steps whose cost is measured
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Hybrid:
    """Hybrid learning: the training in simulation, and the world in which models are measured.

    :ivar config, simulation: of stage 2, for models by reinforcement, see `learning.online.refine`.
    :ivar simulated: near-miss table of simulated interactions, for all others.
    :ivar episodes: (scenario, number) in which every model is measured; seed: of their world.
    """

    config: RefineConfig
    simulation: SimulationConfig
    simulated: pl.DataFrame
    episodes: Sequence[tuple[int, int]]
    seed: int

    def identity(self) -> dict[str, Any]:
        """Return, as JSON values, everything that the training depends on besides recorded data and weights."""
        stage_2 = {"refine": values_of(self.config), "simulation": self.simulation.identity()}
        return stage_2 | {"simulated": table_hash(self.simulated)}

    @property
    def world(self) -> SimulationConfig:
        """The simulation in which models are measured."""
        return replace(self.simulation, episodes=self.episodes, seed=self.seed, batch=256, policies={})

    def ends(self, weights: Weights | None) -> dict[str, int]:
        """Return how many episodes of `world` were critical, and how many of these ended in collisions and at goals.

        :param weights: None: agents keep their velocity.
        """
        outcomes = measure_outcomes(weights, self.world).outcomes
        return {"critical": len(outcomes), "collided": outcomes.count(COLLISION), "at_goals": outcomes.count(GOAL)}


@dataclass
class Pooled:
    """The results of a row of Table 9, fold by fold."""

    errors: list[Measured] = field(default_factory=list)
    positions: list[NDArray[np.float64]] = field(default_factory=list)
    ends: list[Mapping[str, int]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    microseconds: list[float] = field(default_factory=list)
    parameters: int = 0


class Measuring:
    """Measures weights on data that they were not trained on.

    :param together: all interactions that are held out, in the order of the folds.
    :param near_misses: the whole table; seed: of what is drawn and resampled.
    """

    def __init__(self, together: Interactions, near_misses: pl.DataFrame, seed: int) -> None:
        self._together, self._seed = together, seed
        try:
            onsets = find_onsets(near_misses)
        except InvalidInput:  # no track goes on for 3 s
            self._onsets = None
            return
        clips = list(dict.fromkeys(together.clip))
        place = np.array([clips.index(clip) if clip in clips else -1 for clip in onsets.clip])
        rows = np.argsort(place, kind="stable")
        self._onsets = onsets.take(rows[place[rows] >= 0])

    def add(self, row: Pooled, path: Path, held_out: Interactions, hybrid: Hybrid | None) -> None:
        """Measure weights on clips that they were not trained on."""
        weights = load_weights(path)
        if (onsets := self._onsets_of(held_out)) is not None:
            row.positions.append(rolled_out(PolicyPredictor(weights), onsets))
        row.errors.append(measure(PolicyPredictor(weights), held_out))
        if hybrid is not None:
            of = hybrid.world.identity() | {"weights": weights.digest()}
            row.ends.append(once(path.parent / "world", of, partial(hybrid.ends, weights)))
        row.seconds.append(float(read_json(path.with_name(COST))["training_seconds"]))
        row.microseconds.append(_step_cost(weights, held_out))
        row.parameters = sum(v.size for k, v in weights.tensors.items() if "_actor." in k and ".observation_" not in k)

    def _onsets_of(self, held_out: Interactions) -> Onsets | None:
        """Return the onsets of the clips of `held_out`; None where no track goes on for 3 s."""
        if self._onsets is None:
            return None
        mine = np.flatnonzero(np.isin(self._onsets.clip.astype(str), held_out.clip.astype(str)))
        return self._onsets.take(mine) if mine.size else None

    def table(self, rows: Mapping[str, Pooled]) -> dict[str, Any]:
        """Return the measures of all rows in the layout of `model_comparison.compare_models`."""
        errors = {name: pooled(row.errors) for name, row in rows.items()}
        result = compare(errors, self._together, self._seed)
        draws = cluster_counts(units_of(self._together.clip, self._together.group).labels, self._seed)
        for name, row in rows.items():
            of = result["models"][name]
            of["parameters"] = row.parameters
            of["training_seconds"] = float(np.mean(row.seconds))
            of["step_microseconds"] = float(np.median(row.microseconds))
            if row.ends:
                of["world"] = shares_of_ends(row.ends)
            if REFERENCE in errors:
                for protocol, values in errors[name].items():
                    reference = errors[REFERENCE][protocol]
                    of[protocol][f"share_of_{REFERENCE}"] = ade_share(values, reference, draws)
        if self._onsets is not None:
            self._add_people(rows, result["models"])
        return result

    def _add_people(self, rows: Mapping[str, Pooled], models: dict[str, Any]) -> None:
        onsets = self._onsets
        assert onsets is not None
        draws = cluster_counts(onsets.units.labels, self._seed)
        positions = {name: np.concatenate(row.positions) for name, row in rows.items()}
        scored = {name: scores(own, onsets) for name, own in positions.items()}
        for name, own in positions.items():
            models[name]["people"] = self._people(own, scored[name], onsets, draws)
            if REFERENCE in scored:
                value, *ends = estimate(scored[name]["energy"], draws, scored[REFERENCE]["energy"])
                models[name]["people"][f"share_of_{REFERENCE}"] = (value, ends)

    def _people(self, positions: Floats, scored: Scores, onsets: Onsets, draws: Floats) -> dict[str, Any]:
        """Return a subset of what `SameStart.measure` returns, with the classifier's test once instead of ten times."""
        made = features(with_borrowed_noise(positions, onsets, self._seed), onsets)
        real = {name: value[:, 0] for name, value in features(onsets.recorded[:, None], onsets).items()}
        test = two_sample(real, [made], (onsets.units.labels,) * 2, self._seed, repetitions=1)
        energy, likely = (estimate(own, draws) for own in (scored["energy"], likelihoods(positions, onsets)["all"]))
        return {
            "energy_score": energy[0],
            "energy_score_interval": energy[1:],
            "brier": estimate(scored["brier"], draws)[0],
            "likelihood": likely[0],
            "likelihood_interval": likely[1:],
            "c2st_auc": test.auc,
            "c2st_auc_interval": list(test.auc_interval),
        }


def shares_of_ends(ends: Sequence[Mapping[str, int]]) -> dict[str, Any]:
    """Return which shares of critical episodes end in collisions and at goals, of all trainings, with intervals.

    The intervals hold the chance of the episodes, which are the same for each training; that of learning shows in
    `collision_by_training`.

    :param ends: of each training, as `Hybrid.ends` returns them.
    """
    total, collided, at_goals = (sum(each[name] for each in ends) for name in ("critical", "collided", "at_goals"))
    return {
        "critical_episodes": total,
        "collision": list(share(collided, total)[:3]),
        "goal": list(share(at_goals, total)[:3]),
        "collision_by_training": [each["collided"] / max(1, each["critical"]) for each in ends],
    }


def _step_cost(weights: Weights, interactions: Interactions) -> float:
    """Return the CPU time [us] of one step of both actors an interaction, measured on all interactions in parallel."""
    model, count = PolicyPredictor(weights), len(interactions)
    model.begin(count)
    at = np.arange(count), interactions.first
    seen = [interactions.observation[agent][at] for agent in ("vehicle", "pedestrian")]
    rounds = []
    for _ in range(2):  # kernels are compiled in the first, if they have to be
        began = time.process_time()
        for _ in range(_TIMED):
            model.act(seen[0], seen[1], interactions.curvttc[at], np.ones(count, bool))
        rounds.append(time.process_time() - began)
    return 1e6 * min(rounds) / (_TIMED * count)
