"""Table 9 on the near misses at hand: the SST beside other networks, by cross-validation, with naive controls."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.data.interactions import from_table, table_hash
from vpsci_ros.evaluation.errors import compare, share_of
from vpsci_ros.evaluation.folds import held_out_folds, pooled
from vpsci_ros.evaluation.protocols import Measured, measure
from vpsci_ros.learning.checkpoint import load_checkpoint, save_checkpoint
from vpsci_ros.learning.config import PretrainConfig
from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.weights import resolved
from vpsci_ros.runs.files import write_json
from vpsci_ros.studies.networks import MODELS, predictor, train, untrained
from vpsci_ros.studies.state import once

RESULT, REFERENCE, ACTORS = "models.json", "ma_sst", "actors.safetensors"
Row = dict[str, float]


def compare_models(
    near_misses: pl.DataFrame,
    config: PretrainConfig,
    network: NetworkConfig,
    *,
    models: Sequence[str],
    folds: int,
    seed: int,
    out_dir: str | Path,
    report: Callable[[str, Row], None] | None = None,
) -> dict[str, Any]:
    """Train each model once a fold and measure it on the clips held out; write and return `models.json`.

    The layout is that of `errors.evaluate`. Each trained model also has `parameters`, the number of both actors', and,
    where `ma_sst` is among the models and by protocol, `share_of_ma_sst`: its ADE as a share of that model's, and the
    95% interval of the share by resampling clips. A training that is stopped begins again; finished ones are kept.

    :param models: of `vpsci_ros.studies.networks.MODELS`.
    :param report: called with the fold's name ("1", ...) and what `train` reports, updates counted over all its models.
    :raises InvalidInput: as `held_out_folds`, `network.carry_state` is false, or `out_dir` holds another study.
    """
    parts, together = held_out_folds(near_misses, folds, seed)
    out_dir = Path(out_dir)
    config = replace(config, held_out_clips=[], held_out_fraction=0.0)
    identity = resolved(config, network) | {"seed": seed, "data": table_hash(near_misses), "folds": folds}
    measured: dict[str, list[Measured]] = {name: [] for name in models}
    for number, (training, held_out) in enumerate(parts, 1):
        for place, name in enumerate(models):
            folder = out_dir / f"fold_{number}" / name
            once(folder, identity | {"fold": number, "model": name}, dict)
            report_model = None if report is None else partial(_pass_on, report, f"{number}", place, len(models))
            trained = _trained(name, training, config, network, seed, folder / ACTORS, report_model)
            measured[name].append(measure(predictor(MODELS.find(name), trained), held_out))
    errors = {name: pooled(parts_of_it) for name, parts_of_it in measured.items()}
    result = compare(errors, together, seed) | {"folds": folds}
    for name, own in errors.items():
        row = result["models"][name]
        row["parameters"] = sum(p.numel() for p in untrained(MODELS.find(name), network, seed).actor.parameters())
        if REFERENCE in errors:
            for protocol, values in own.items():
                row[protocol]["share_of_ma_sst"] = share_of(values, errors[REFERENCE][protocol], together.clip, seed)
    write_json(out_dir / RESULT, result)
    return result


def _pass_on(report: Callable[[str, Row], None], fold: str, place: int, models: int, values: Row) -> None:
    """Pass on what `train` reports, counting the updates of all models of a fold."""
    done, each = values["episode"], values["episodes"]
    report(fold, values | {"episode": place * each + done, "episodes": models * each})


def _trained(
    name: str,
    training: pl.DataFrame,
    config: PretrainConfig,
    network: NetworkConfig,
    seed: int,
    path: Path,
    report: Callable[[Row], None] | None,
) -> Networks:
    """Return the trained networks, whose target actors are in `path`, or come to be."""
    if path.exists():
        networks = untrained(MODELS.find(name), network, seed)
        networks.target_actor.load_state_dict(load_checkpoint(path)["actors"])
        networks.actor.load_state_dict(networks.target_actor.state_dict())
        return networks
    networks = train(MODELS.find(name), from_table(training), config, network, seed, report)
    save_checkpoint(path, {"actors": dict(networks.target_actor.state_dict())})
    return networks
