"""Table 9 on given near misses: all of the table's models, with and without hybrid learning, and naive controls.

Data-driven: learned from recorded near misses. Hybrid (`..._refined`): gone on from there with simulation, models by
reinforcement as `vpsci refine` trains them, the others on simulated interactions among the recorded ones.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data.corpus import NO_CLIPS, table_hash
from vpsci_ros.data.interactions import from_table
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.studies.folds import held_out_folds
from vpsci_ros.extras.paper.studies.model_table import COST, REFERENCE, Hybrid, Measuring, Pooled, shares_of_ends
from vpsci_ros.extras.paper.studies.networks import Report, by_reinforcement, train, untrained
from vpsci_ros.extras.paper.studies.state import StudyReport, once, side_by_side
from vpsci_ros.learning import online
from vpsci_ros.learning import refine as stage_2
from vpsci_ros.learning.training_config import PretrainConfig
from vpsci_ros.policy.models import MODELS
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import Weights, load_weights, resolved, save_weights
from vpsci_ros.runs.files import write_json
from vpsci_ros.runs.workers import HERE, Site

RESULT, WEIGHTS, REFINED, DONE = "models.json", "weights.safetensors", "_refined", "done"


def compare_models(
    near_misses: pl.DataFrame,
    config: PretrainConfig,
    network: NetworkConfig,
    *,
    models: Sequence[str],
    folds: int,
    seed: int,
    out_dir: str | Path,
    hybrid: Hybrid | None = None,
    site: Site = HERE,
    report: StudyReport = lambda *_: None,
) -> dict[str, Any]:
    """Train each model in each fold, measure on its held-out clips; write and return `models.json`.

    The layout is that of `errors.evaluate`. Each model also has `parameters` (of both actors), `training_seconds` (of
    CPU, one training), `step_microseconds` (of CPU, both actors, one interaction among those of a fold), `people` (a
    subset of `vpsci realism`: energy score, Brier score, likelihood, classifier), with `hybrid` `world`
    (`shares_of_ends`; also of the controls `constant_velocity` and, by untrained networks, `fading_acceleration`),
    and, where `ma_sst_ddpg` is among the models, its ADE by protocol and its energy score as shares of that model's,
    with 95% intervals. A training that is stopped begins again; finished ones are kept. One by reinforcement in
    simulation goes on from its checkpoint: its `training_seconds` are those of the last part.

    :param models: of `vpsci_ros.policy.models.MODELS`.
    :param seed: of folds and trainings.
    :param hybrid: None: data-driven learning alone.
    :param site: where the models are learned: each in each fold by one worker.
    :param report: called with the fold's name ("1", ...) and what `train` reports, updates counted over all its models.
    :raises InvalidInput: as `held_out_folds`; an objective is chosen, which this study would ignore; or
        `out_dir` holds another study.
    """
    if config.objective not in (PretrainConfig.objective, "ddpg"):  # as the parameter files have them
        raise InvalidInput(
            f"learner.objective = {config.objective}: each model of this study has its own; leave it out"
        )
    parts, together = held_out_folds(near_misses, folds, seed)
    measuring, out_dir = Measuring(together, near_misses, seed), Path(out_dir)
    config = replace(config, held_out_clips=[NO_CLIPS])
    identity = resolved(config, network) | {"seed": seed, "data": table_hash(near_misses), "folds": folds}
    data_driven: dict[str, Pooled] = {}
    refined: dict[str, Pooled] = {}
    tables = [training for training, _ in parts]
    learner = _Learner(tables, config, network, models, seed, hybrid, identity)
    pairs = [(number, name) for number in range(1, folds + 1) for name in models]
    todo = [pair for pair in pairs if not (_folder(out_dir, *pair) / DONE).exists()]
    side_by_side(site, learner.learn, todo, out_dir, report)
    for number, name in pairs:
        held_out = parts[number - 1][1]
        path, gone_on = learner.learn(out_dir, (number, name), report)
        measuring.add(data_driven.setdefault(name, Pooled()), path, held_out, hybrid)
        if gone_on is not None:
            measuring.add(refined.setdefault(name + REFINED, Pooled()), gone_on, held_out, hybrid)
    result = measuring.table(data_driven | refined) | {"folds": folds}
    if hybrid is not None:
        nothing = untrained(REFERENCE, network, seed).weights({}, {})
        result["models"]["constant_velocity"]["world"] = shares_of_ends([hybrid.ends(None)])
        result["models"]["fading_acceleration"]["world"] = shares_of_ends([hybrid.ends(nothing)])
    write_json(out_dir / RESULT, result)
    return result


def _folder(out_dir: Path, number: int, name: str) -> Path:
    return out_dir / f"fold_{number}" / name


@dataclass(frozen=True)
class _Learner:
    """The trainings of all models in all folds; see `compare_models` for the fields.

    :ivar tables: training data of each fold.
    """

    tables: Sequence[pl.DataFrame]
    config: PretrainConfig
    network: NetworkConfig
    models: Sequence[str]
    seed: int
    hybrid: Hybrid | None
    identity: Mapping[str, Any]

    def learn(
        self, out_dir: Path, pair: tuple[int, str], report: StudyReport = lambda *_: None
    ) -> tuple[Path, Path | None]:
        """Return the files of a model's weights in a fold, data-driven and hybrid.

        :param pair: number of the fold, name of the model.
        """
        (number, name), folder = pair, _folder(out_dir, *pair)
        report_model = partial(_pass_on, report, f"{number}", self.models.index(name), len(self.models))
        of = {**self.identity, "fold": number, "model": name}
        run = _Run(name, self.tables[number - 1], self.config, self.network, self.seed, folder, of)
        path = run.data_driven(report_model)
        gone_on = None if self.hybrid is None else run.hybrid(self.hybrid)
        (folder / DONE).touch()
        return path, gone_on


def _pass_on(report: StudyReport, fold: str, place: int, models: int, values: dict[str, float]) -> None:
    """Pass on what `train` reports, counting the updates of all models of a fold."""
    done, each = values["episode"], values["episodes"]
    report(fold, values | {"episode": place * each + done, "episodes": models * each})


@dataclass(frozen=True)
class _Run:
    """One training of one model on the near misses `table`, whose weights go to `folder`."""

    name: str
    table: pl.DataFrame
    config: PretrainConfig
    network: NetworkConfig
    seed: int
    folder: Path
    identity: dict[str, Any]

    def data_driven(self, report: Report) -> Path:
        """Return the file of the weights learned from recorded near misses; train unless it exists."""
        once(self.folder, self.identity, dict)
        return self._trained(self.folder / WEIGHTS, self.table, self.config, report=report)

    def hybrid(self, hybrid: Hybrid) -> Path:
        """Return the file of the weights trained further with simulation; train unless it exists.

        Models by reinforcement run stage 2; the others get half as many updates, at 0.3 times the step sizes, on
        recorded and simulated near misses.
        """
        folder, start = self.folder / "refined", load_weights(self.folder / WEIGHTS)
        once(folder, hybrid.identity() | {"weights": start.digest()}, dict)
        if not by_reinforcement(self.name):
            updates = self.config.updates
            actors, critics = 0.3 * updates.actor_learning_rate, 0.3 * updates.critic_learning_rate
            updates = replace(updates, actor_learning_rate=actors, critic_learning_rate=critics)
            config = replace(self.config, updates=updates, episodes=max(1, self.config.episodes // 2))
            most = self.table["interaction"].max() + 1  # type: ignore[operator]
            both = [self.table, hybrid.simulated.with_columns(pl.col("interaction") + most)]
            return self._trained(folder / WEIGHTS, pl.concat(both), config, start=start)
        path = folder / stage_2.WEIGHTS
        if not (folder / COST).exists():  # which is written last; what was killed goes on from its checkpoint
            own = replace(hybrid.config, objective=MODELS.find(self.name).learning)
            began = time.process_time()
            online.refine(self.table, own, start, hybrid.simulation, learner_seed=self.seed, out_dir=folder)
            write_json(folder / COST, {"training_seconds": time.process_time() - began})
        return path

    def _trained(
        self,
        path: Path,
        table: pl.DataFrame,
        config: PretrainConfig,
        *,
        report: Report = lambda _: None,
        start: Weights | None = None,
    ) -> Path:
        if path.exists():
            return path
        interactions, began = from_table(table), time.process_time()
        networks = train(self.name, interactions, config, self.network, self.seed, report, start)
        write_json(path.with_name(COST), {"training_seconds": time.process_time() - began})
        facts: dict[str, Any] = {"stage": "pretrained" if start is None else "refined", "seed": self.seed}
        facts["data"] = {"sha256": table_hash(table)}
        save_weights(path, networks.weights(resolved(config), facts))
        return path
