"""What a dataset says of its episodes: the index, one row each, the counts by scenario, and dataset.json."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.dataset_files import DATASET_COLUMNS, INDEX_COLUMNS
from vpsci_ros.data.filters import KEPT, REASONS, FilterConfig
from vpsci_ros.documents import Form
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.world.state import COLLISION, OUTCOME_NAMES, PARKED_COLLISION

DESCRIPTION = "dataset.json"
_COUNTED = {"kept": int, "collisions": int, "least_curvttc": list}
FORM: Form = {  # what is read of any dataset's description
    "period": (float, int),
    "unfinished": int,
    "scenarios": {
        "*": {
            "number": int,
            "simulated": int,
            "kept": int,
            "acceptance_rate": (float, int, NoneType),
            "rejected": dict.fromkeys(REASONS[1:], int),
            "failed": dict.fromkeys(REASONS[1:], int),
            "outcomes": dict.fromkeys(OUTCOME_NAMES[1:PARKED_COLLISION], int),
            "kept_outcomes": dict.fromkeys(OUTCOME_NAMES[1:PARKED_COLLISION], int),
            "rejected_collisions": dict.fromkeys(REASONS[1:], int),
            "vehicle_km": (float, int),
            "pedestrian_km": (float, int),
        }
    },
    "files": {"*": {"sha256": str}},
    "versions": {"vpsci_ros": str},
}
FORM_OF_GENERATED: Form = {  # besides, of one that `vpsci generate` made
    "cpu": str,
    "first_episode": int,
    "all": {"least_curvttc": list, "with_early_collisions": _COUNTED},
    "filters": {"least_frames": int},
}
INDEX = "episodes.parquet"
REJECTED = "rejected"


class Tally:
    """Counts of one scenario."""

    def __init__(self) -> None:
        self._reasons: Counter[str] = Counter()
        self._failed = np.zeros(len(REASONS) - 1, np.int64)
        self._outcomes: Counter[str] = Counter()
        self._kept_outcomes: Counter[str] = Counter()
        self._lost_collisions: Counter[str] = Counter()
        self._kilometres = np.zeros(2)

    def add(
        self,
        reason: NDArray[np.uint8],
        outcome: NDArray[np.uint8],
        failed: NDArray[np.bool_],
        vehicle_path: NDArray[np.float64],
        pedestrian_path: NDArray[np.float64],
    ) -> None:
        """Count episodes: what `vpsci_ros.data.filters.Judgement` says of each, and how it ended."""
        kept = reason == KEPT
        self._reasons.update(REASONS[i] for i in reason.tolist())
        self._failed += failed.sum(axis=0)
        self._outcomes.update(OUTCOME_NAMES[i] for i in outcome.tolist())
        self._kept_outcomes.update(OUTCOME_NAMES[i] for i in outcome[kept].tolist())
        self._lost_collisions.update(REASONS[i] for i in reason[~kept & (outcome == COLLISION)].tolist())
        self._kilometres += [vehicle_path[kept].sum(), pedestrian_path[kept].sum()]

    def summary(self) -> dict[str, Any]:
        """Return simulated, kept, acceptance rate, rejected by reason, failed by condition, outcomes, kilometres."""
        simulated, kept = sum(self._reasons.values()), self._reasons["kept"]
        return {
            "simulated": simulated,
            "kept": kept,
            "acceptance_rate": kept / simulated if simulated else None,
            "rejected": {name: self._reasons[name] for name in REASONS[1:]},
            "failed": dict(zip(REASONS[1:], self._failed.tolist(), strict=True)),
            "outcomes": _by_name(self._outcomes),
            "kept_outcomes": _by_name(self._kept_outcomes),
            "rejected_collisions": {name: self._lost_collisions[name] for name in REASONS[1:]},
            "vehicle_km": round(float(self._kilometres[0]) / 1000.0, 6),
            "pedestrian_km": round(float(self._kilometres[1]) / 1000.0, 6),
        }


def _by_name(outcomes: Counter[str]) -> dict[str, int]:
    """Return how often each outcome came; that of parked vehicles, which most worlds lack, only where it did."""
    usual = OUTCOME_NAMES[1:PARKED_COLLISION]
    return {name: outcomes[name] for name in OUTCOME_NAMES[1:] if outcomes[name] or name in usual}


def index_table(parts: Sequence[tuple[NDArray[Any], ...]]) -> pl.DataFrame:
    """Return the index: `parts` hold the columns of `INDEX_COLUMNS`, outcomes and reasons as codes."""
    schema = {name: column.dtype for name, column in INDEX_COLUMNS.items()}
    if not parts:
        return pl.DataFrame(schema=schema)
    columns = dict(zip(INDEX_COLUMNS, (np.concatenate(column) for column in zip(*parts, strict=True)), strict=True))
    table = pl.DataFrame(columns).with_columns(
        pl.col("outcome").replace_strict(dict(enumerate(OUTCOME_NAMES)), return_dtype=pl.String),
        pl.col("reason").replace_strict(dict(enumerate(REASONS)), return_dtype=pl.String),
    )
    return table.cast(schema).sort("scenario", "count")  # type: ignore[arg-type]


def description_of(
    provenance: Mapping[str, Any],
    filters: FilterConfig,
    unfinished: int,
    scenarios: Mapping[str, Any],
    files: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the content of dataset.json."""
    return {
        "content": "vehicle-pedestrian safety-critical interaction episodes",
        **provenance,
        "filters": asdict(filters),
        "unfinished": unfinished,
        "scenarios": dict(scenarios),
        "columns": {n: {"unit": c.unit, "description": c.description} for n, c in DATASET_COLUMNS.items()},
        "files": dict(files),
        "versions": software_versions(),
    }


def file_entry(path: Path, rows: int) -> dict[str, Any]:
    """Return what dataset.json says of a file."""
    return {"rows": rows, "bytes": path.stat().st_size, "sha256": sha256(path)}
