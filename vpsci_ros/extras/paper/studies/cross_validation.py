"""Cross-validation of stages 1 and 2: errors on each clip while it is held out, each clip once.

A few dozen vehicles make one split a lottery: held out or not, a single braking car moves the mean. Cross-validation
trains as often as there are folds and measures every interaction by the policies that have not learned from its clip.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data.near_misses import table_hash
from vpsci_ros.evaluation.errors import compare
from vpsci_ros.evaluation.held_out import NO_CLIPS
from vpsci_ros.evaluation.predictors import PolicyPredictor
from vpsci_ros.evaluation.protocols import Measured, measure
from vpsci_ros.extras.paper.studies.folds import held_out_folds, pooled
from vpsci_ros.extras.paper.studies.networks import Report
from vpsci_ros.extras.paper.studies.state import StudyReport, once, side_by_side, trained
from vpsci_ros.learning import online
from vpsci_ros.learning import pretrain as stage_1
from vpsci_ros.learning import refine as stage_2
from vpsci_ros.learning.training_config import PretrainConfig, RefineConfig
from vpsci_ros.parameters import values_of
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.policy.weights import Weights, resolved
from vpsci_ros.runs.files import write_json
from vpsci_ros.runs.workers import HERE, Site

RESULT = "cross_validation.json"
PRETRAINED, REFINED = "pretrained", "refined"


@dataclass(frozen=True)
class Refinement:
    """Configuration of stage 2 in every fold, for `vpsci_ros.learning.online.refine`.

    What guards against forgetting is a fifth of the fold's own clips, since the clips held out are for measuring alone.
    """

    config: RefineConfig
    simulation: SimulationConfig
    learner_seed: int

    def identity(self) -> dict[str, Any]:
        """Return, as JSON values, everything that the result of stage 2 depends on besides weights and data."""
        return {
            "refine": values_of(self.config),
            "simulation": self.simulation.identity(),
            "learner_seed": self.learner_seed,
        }


def cross_validate(
    near_misses: pl.DataFrame,
    config: PretrainConfig,
    network: NetworkConfig,
    *,
    folds: int,
    seed: int,
    out_dir: str | Path,
    refinement: Refinement | None = None,
    site: Site = HERE,
    report: StudyReport = lambda *_: None,
) -> dict[str, Any]:
    """Train once in each fold, measure on the fold's held-out clips, and write and return `cross_validation.json`.

    The layout is that of `errors.evaluate`, with the model `pretrained` and, if there is a refinement, `refined`: their
    errors are those of all interactions, each by the fold's policies that have not learned from its clip. `folds` adds
    the fold's own n, clips and closed-loop ADE as a share of `repeat_velocity`'s, by model. The intervals do not hold
    how much a training's seed matters.

    :param seed: of folds and trainings of stage 1.
    :param refinement: stage 2; None: stage 1 alone.
    :param site: where the folds are learned.
    :param report: called with the fold's name ("1", or "1, stage 2") and what `pretrain` or `refine` reports.
    :raises InvalidInput: `folds` is not from 2 to the number of clips, a fold has no interaction that lasts a second,
        or `out_dir` holds another study.
    """
    parts, together = held_out_folds(near_misses, folds, seed)
    out_dir = Path(out_dir)
    config = replace(config, held_out_clips=[NO_CLIPS])
    identity = resolved(config, network) | {"seed": seed, "data": table_hash(near_misses), "folds": folds}
    learner = _Learner([table for table, _ in parts], config, network, seed, refinement, identity)
    todo = [number for number in range(1, folds + 1) if not learner.is_finished(out_dir, number)]
    side_by_side(site, learner.policies, todo, out_dir, report)
    measured: list[dict[str, Measured]] = []
    shares = []
    for number, (_, interactions) in enumerate(parts, 1):
        policies = learner.policies(out_dir, number, report)
        own = {name: measure(PolicyPredictor(weights), interactions) for name, weights in policies.items()}
        measured.append(own)
        result = compare(own, interactions, seed)
        ratios = {name: result["models"][name]["closed_loop"]["ade_ratio"] for name in own}
        shares.append({"interactions": len(interactions), "clips": result["clips"], "closed_loop_ade_ratio": ratios})
    errors = {name: pooled([own[name] for own in measured]) for name in measured[0]}
    result = compare(errors, together, seed) | {"folds": shares}
    write_json(out_dir / RESULT, result)
    return result


@dataclass(frozen=True)
class _Learner:
    """The trainings of all folds.

    :ivar tables: training data of each fold.
    """

    tables: Sequence[pl.DataFrame]
    config: PretrainConfig
    network: NetworkConfig
    seed: int
    refinement: Refinement | None
    identity: Mapping[str, Any]

    def policies(self, out_dir: Path, number: int, report: StudyReport = lambda *_: None) -> dict[str, Weights]:
        """Return the weights of a fold, learned in its folder unless they are there."""
        folder, table = out_dir / f"fold_{number}", self.tables[number - 1]
        once(folder, {**self.identity, "fold": number}, dict)
        train = partial(stage_1.pretrain, table, self.config, self.network, seed=self.seed, out_dir=folder)
        train = partial(train, report=partial(report, f"{number}"))
        policies = {PRETRAINED: trained(folder, stage_1.WEIGHTS, stage_1.CHECKPOINT, train)}
        if self.refinement is not None:
            start, shown = policies[PRETRAINED], partial(report, f"{number}, stage 2")
            policies[REFINED] = _refined(table, self.refinement, start, folder / REFINED, shown)
        return policies

    def is_finished(self, out_dir: Path, number: int) -> bool:
        """Return whether the weights of a fold are in its folder."""
        folder, stage = (out_dir / f"fold_{number}", stage_1) if self.refinement is None else (
            out_dir / f"fold_{number}" / REFINED, stage_2)  # fmt: skip
        return (folder / stage.WEIGHTS).exists() and not (folder / stage.CHECKPOINT).exists()


def _refined(training: pl.DataFrame, refinement: Refinement, start: Weights, folder: Path, report: Report) -> Weights:
    """Return the weights of stage 2 on a fold's own clips, from those of its stage 1."""
    once(folder, refinement.identity() | {"weights": start.digest()}, dict)
    config, seed = refinement.config, refinement.learner_seed
    train = partial(
        online.refine, training, config, start, refinement.simulation, learner_seed=seed, out_dir=folder, report=report
    )
    return trained(folder, stage_2.WEIGHTS, stage_2.CHECKPOINT, train)
