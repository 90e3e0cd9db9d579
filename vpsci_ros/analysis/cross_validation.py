"""Errors of stage 1 on people it has not seen, of the whole data: every clip is held out once.

A few dozen vehicles make one split a lottery: held out or not, a single braking car moves the mean. Cross-validation
trains as often as there are folds and measures every interaction by the policies that have not learned from its clip.
"""

import json
from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vpsci_ros.analysis.errors import Measured, compare, measure
from vpsci_ros.data.near_misses import folds_by_clip
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning import pretrain as stage_1
from vpsci_ros.learning.config import NetworkConfig, PretrainConfig
from vpsci_ros.learning.interactions import from_table, table_hash
from vpsci_ros.learning.predictors import PolicyPredictor
from vpsci_ros.learning.protocols import ProtocolErrors, eligible
from vpsci_ros.learning.study_state import once
from vpsci_ros.learning.weights import load_weights, resolved
from vpsci_ros.provenance import written_whole

RESULT = "cross_validation.json"


def cross_validate(
    near_misses: pl.DataFrame,
    config: PretrainConfig,
    network: NetworkConfig,
    *,
    folds: int,
    seed: int,
    out_dir: str | Path,
    report: Callable[[str, stage_1.Report], None] | None = None,
) -> dict[str, Any]:
    """Train stage 1 once a fold and measure it on the clips held out; write and return `cross_validation.json`.

    The layout is that of `errors.evaluate`, with the model `pretrained`: its errors are those of all interactions, each
    by the fold's policies that have not learned from its clip. `folds` adds the fold's own n, clips and closed-loop ADE
    as a share of `repeat_velocity`'s. The intervals resample clips and do not tell how much a training's seed matters.

    :param seed: of folds and trainings.
    :param report: called with the fold's name ("1", ...) and what `pretrain` reports.
    :raises InvalidInput: `folds` is not from 2 to the number of clips, a fold has no interaction that lasts a second,
        or `out_dir` holds another study.
    """
    parts = folds_by_clip(near_misses, folds, seed)
    held_out = []
    for number, (_, kept_out) in enumerate(parts, 1):
        try:
            held_out.append(eligible(from_table(kept_out)))
        except InvalidInput as error:
            raise InvalidInput(f"fold {number} of {folds}: {error}; take fewer folds") from None
    out_dir = Path(out_dir)
    config = replace(config, held_out_fraction=0.0)
    identity = resolved(config, network) | {"seed": seed, "data": table_hash(near_misses), "folds": folds}
    measured, shares = [], []
    for number, ((training, _), interactions) in enumerate(zip(parts, held_out, strict=True), 1):
        folder = out_dir / f"fold_{number}"
        once(folder, identity | {"fold": number}, dict)
        if not (folder / stage_1.WEIGHTS).exists() or (folder / stage_1.CHECKPOINT).exists():
            told = None if report is None else partial(report, f"{number}")
            stage_1.pretrain(training, config, network, seed=seed, out_dir=folder, report=told)
        own = measure(PolicyPredictor(load_weights(folder / stage_1.WEIGHTS)), interactions)
        measured.append(own)
        result = compare({"pretrained": own}, interactions, seed)
        ratio = result["models"]["pretrained"]["closed_loop"]["ade_ratio"]
        shares.append({"interactions": len(interactions), "clips": result["clips"], "closed_loop_ade_ratio": ratio})
    together = eligible(from_table(pl.concat([kept_out for _, kept_out in parts])))
    result = compare({"pretrained": _pooled(measured)}, together, seed) | {"folds": shares}
    with written_whole(out_dir / RESULT) as part:
        part.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return result


def _pooled(measured: list[Measured]) -> Measured:
    return {
        protocol: ProtocolErrors(
            *(np.concatenate([getattr(m[protocol], field.name) for m in measured]) for field in fields(ProtocolErrors))
        )
        for protocol in measured[0]
    }
