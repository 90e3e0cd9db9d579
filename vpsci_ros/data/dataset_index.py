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
from vpsci_ros.data.episode_block import EpisodeBlock
from vpsci_ros.data.filters import REASONS, FilterConfig
from vpsci_ros.documents import Form
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.world.state import COLLISION, OUTCOME_NAMES, PARKED_COLLISION

DESCRIPTION = "dataset.json"
DATASHEET = "README.md"
_TOO_SHORT = REASONS.index("too short") - 1  # of the conditions in `failed`
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
    "all": {"least_curvttc": list, "with_early_collisions": _COUNTED},
    "filters": {"least_frames": int},
    "files": {"*": {"sha256": str}},
    "versions": {"vpsci_ros": str},
}
FORM_OF_GENERATED: Form = {  # besides, of one that `vpsci generate` made
    "cpu": str,
    "first_episode": int,
}
INDEX = "episodes.parquet"
REJECTED = "rejected"


class Tally:
    """Counts of one scenario."""

    def __init__(self) -> None:
        self._reasons: Counter[str] = Counter()
        self._failed = np.zeros(len(REASONS) - 1, np.int64)
        self._outcomes: Counter[str] = Counter()
        self.kept_outcomes: Counter[str] = Counter()
        self._lost_collisions: Counter[str] = Counter()
        self._kilometres = np.zeros(2)
        self.least: list[NDArray[np.float32]] = []
        self.least_early: list[NDArray[np.float32]] = []

    def add(self, block: EpisodeBlock) -> None:
        """Count episodes: what the filters say of each, and how it ended."""
        kept = block.kept
        self._reasons.update(REASONS[i] for i in block.reason.tolist())
        self._failed += block.failed.sum(axis=0)
        self._outcomes.update(OUTCOME_NAMES[i] for i in block.outcome.tolist())
        self.kept_outcomes.update(OUTCOME_NAMES[i] for i in block.outcome[kept].tolist())
        self._lost_collisions.update(REASONS[i] for i in block.reason[~kept & (block.outcome == COLLISION)].tolist())
        self._kilometres += [block.vehicle_path[kept].sum(), block.pedestrian_path[kept].sum()]
        self.least.append(block.least_curvttc[kept])
        self.least_early.append(block.least_curvttc[_early_collisions(block)])

    def summary(self) -> dict[str, Any]:
        """Return simulated, kept, acceptance rate, rejected by reason, failed by condition, outcomes, km, nearness."""
        simulated, kept = sum(self._reasons.values()), self._reasons["kept"]
        return {
            "simulated": simulated,
            "kept": kept,
            "acceptance_rate": kept / simulated if simulated else None,
            "rejected": {name: self._reasons[name] for name in REASONS[1:]},
            "failed": dict(zip(REASONS[1:], self._failed.tolist(), strict=True)),
            "outcomes": _by_name(self._outcomes),
            "kept_outcomes": _by_name(self.kept_outcomes),
            "rejected_collisions": {name: self._lost_collisions[name] for name in REASONS[1:]},
            "vehicle_km": round(float(self._kilometres[0]) / 1000.0, 6),
            "pedestrian_km": round(float(self._kilometres[1]) / 1000.0, 6),
            **nearness([self]),
        }


def nearness(tallies: Sequence[Tally]) -> dict[str, Any]:
    """Return quartiles of the least CurvTTC of the kept episodes [s], and the same with early collisions put back.

    Early collisions are rejected for nothing but ending the episode too early. Without episodes there are no quartiles.
    """
    least = [least for tally in tallies for least in tally.least]
    early = [least for tally in tallies for least in tally.least_early]
    collisions = sum(tally.kept_outcomes[OUTCOME_NAMES[COLLISION]] for tally in tallies)
    return {
        "least_curvttc": _quartiles(least),
        "with_early_collisions": {
            "kept": sum(map(len, [*least, *early])),
            "collisions": collisions + sum(map(len, early)),
            "least_curvttc": _quartiles([*least, *early]),
        },
    }


def _quartiles(least: Sequence[NDArray[np.float32]]) -> list[float]:
    values = np.concatenate([np.zeros(0), *least])
    return [round(float(value), 4) for value in np.quantile(values, (0.25, 0.5, 0.75))] if len(values) else []


def _early_collisions(block: EpisodeBlock) -> NDArray[np.bool_]:
    others = np.delete(block.failed, _TOO_SHORT, axis=1).any(axis=1)
    mask: NDArray[np.bool_] = block.failed[:, _TOO_SHORT] & ~others & (block.outcome == COLLISION)
    return mask


def _by_name(outcomes: Counter[str]) -> dict[str, int]:
    """Return how often each outcome came; that of parked vehicles, which most worlds lack, only where it did."""
    usual = OUTCOME_NAMES[1:PARKED_COLLISION]
    return {name: outcomes[name] for name in OUTCOME_NAMES[1:] if outcomes[name] or name in usual}


def index_columns(scenario: int, block: EpisodeBlock) -> tuple[NDArray[Any], ...]:
    """Return the columns of `INDEX_COLUMNS` for episodes of a scenario, outcomes and reasons as codes."""
    of_scenario = np.full(len(block), scenario, np.uint8)
    lengths = block.vehicle_path.astype(np.float32), block.pedestrian_path.astype(np.float32)
    return (of_scenario, block.number, block.outcome, block.reason, block.frames, block.least_curvttc, *lengths)


def index_table(parts: Sequence[tuple[NDArray[Any], ...]]) -> pl.DataFrame:
    """Return the index of what `index_columns` gives."""
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
    tallies: Mapping[str, tuple[int, Tally]],
    files: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the content of dataset.json.

    :param tallies: number and counts of each scenario, by its name.
    """
    return {
        "content": "vehicle-pedestrian safety-critical interaction episodes",
        **provenance,
        "all": nearness([tally for _, tally in tallies.values()]),
        "filters": asdict(filters),
        "unfinished": unfinished,
        "scenarios": {name: {"number": number, **tally.summary()} for name, (number, tally) in tallies.items()},
        "columns": {n: {"unit": c.unit, "description": c.description} for n, c in DATASET_COLUMNS.items()},
        "files": dict(files),
        "versions": software_versions(),
    }


def file_entry(path: Path, rows: int) -> dict[str, Any]:
    """Return what dataset.json says of a file."""
    return {"rows": rows, "bytes": path.stat().st_size, "sha256": sha256(path)}
