"""The content of dataset.json: counts by scenario and reason, quartiles of the least CurvTTC, hashes of all files."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.dataset_tables import EPISODE_COLUMNS
from vpsci_ros.data.episode_block import JUDGED, KEPT, RANGES, REASONS
from vpsci_ros.data.filters import FilterConfig
from vpsci_ros.documents import Form
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.world.state import COLLISION, OUTCOME_NAMES, PARKED_COLLISION

DESCRIPTION = "dataset.json"
DATASHEET = "README.md"
_TOO_SHORT = REASONS.index("too short") - 1  # of the conditions in `failed`
_LEAST = [(float, int)]
_COUNTED = {"kept": int, "collisions": int, "least_curvttc": _LEAST}
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
    "all": {"least_curvttc": _LEAST, "with_early_collisions": _COUNTED},
    "filters": {"least_frames": int},
    "files": {"*": {"sha256": str}},
    "versions": {"vpsci_ros": str},
}
FORM_OF_GENERATED: Form = {  # besides, of one that `vpsci generate` made
    "cpu": str,
}


def counts_of(records: NDArray[np.void]) -> dict[str, Any]:
    """Return counts of JUDGED[n]: simulated, kept, rejected by reason, path lengths, least CurvTTC."""
    kept = records["reason"] == KEPT
    return {
        "simulated": len(records),
        "kept": int(kept.sum()),
        "acceptance_rate": int(kept.sum()) / len(records) if len(records) else None,
        "rejected": _by_reason(records),
        "failed": dict(zip(REASONS[1:], records["failed"].sum(axis=0).tolist(), strict=True)),
        "outcomes": _by_outcome(records),
        "kept_outcomes": _by_outcome(records[kept]),
        "rejected_collisions": _by_reason(records[~kept & (records["outcome"] == COLLISION)]),
        "vehicle_km": round(float(records["vehicle_path"][kept].sum(dtype=np.float64)) / 1000.0, 6),
        "pedestrian_km": round(float(records["pedestrian_path"][kept].sum(dtype=np.float64)) / 1000.0, 6),
        "beyond_range": _beyond(records[kept]),
        **nearness(records),
    }


def _beyond(records: NDArray[np.void]) -> dict[str, int] | None:
    """Return the numbers of episodes beyond the recorded range and of those with a known `range`; None without any."""
    known = int((records["range"] > 0).sum())
    return {"episodes": int((records["range"] == RANGES.index("beyond")).sum()), "of": known} if known else None


def nearness(records: NDArray[np.void]) -> dict[str, Any]:
    """Return quartiles of the least CurvTTC [s] of kept episodes, without and with collisions that are only too short.

    Early collisions are rejected for nothing but ending the episode too early. Without episodes there are no quartiles.
    """
    kept, collided = records["reason"] == KEPT, records["outcome"] == COLLISION
    others = np.delete(records["failed"], _TOO_SHORT, axis=1).any(axis=1)
    put_back = kept | (records["failed"][:, _TOO_SHORT] & ~others & collided)
    return {
        "least_curvttc": _quartiles(records["least_curvttc"][kept]),
        "with_early_collisions": {
            "kept": int(put_back.sum()),
            "collisions": int((put_back & collided).sum()),
            "least_curvttc": _quartiles(records["least_curvttc"][put_back]),
        },
    }


def _quartiles(least: NDArray[np.float32]) -> list[float]:
    values = np.quantile(least.astype(np.float64), (0.25, 0.5, 0.75)) if len(least) else np.zeros(0)
    return [round(float(value), 4) for value in values]


def _by_reason(records: NDArray[np.void]) -> dict[str, int]:
    counts = np.bincount(records["reason"], minlength=len(REASONS)).tolist()
    return dict(zip(REASONS[1:], counts[1:], strict=True))


def _by_outcome(records: NDArray[np.void]) -> dict[str, int]:
    """Return the number of episodes with each outcome; `parked_collision` only if there is such an episode."""
    counts = np.bincount(records["outcome"], minlength=len(OUTCOME_NAMES)).tolist()
    return {
        name: counts[code]
        for code, name in enumerate(OUTCOME_NAMES)
        if code and (counts[code] or code < PARKED_COLLISION)
    }


def description_of(
    provenance: Mapping[str, Any],
    filters: FilterConfig,
    unfinished: int,
    records: Mapping[str, tuple[int, NDArray[np.void]]],
    files: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the content of dataset.json.

    :param records: number and JUDGED[n] of each scenario, by its name.
    """
    return {
        "content": "vehicle-pedestrian safety-critical interaction episodes",
        **provenance,
        "all": nearness(np.concatenate([np.zeros(0, JUDGED), *(own for _, own in records.values())])),
        "filters": asdict(filters),
        "unfinished": unfinished,
        "scenarios": {name: {"number": number, **counts_of(own)} for name, (number, own) in records.items()},
        "columns": {n: {"unit": c.unit, "description": c.description} for n, c in EPISODE_COLUMNS.items()},
        "files": dict(files),
        "versions": software_versions(),
    }


def file_entry(path: Path, rows: int) -> dict[str, Any]:
    """Return the entry of a file in dataset.json: its rows, bytes and SHA-256."""
    return {"rows": rows, "bytes": path.stat().st_size, "sha256": sha256(path)}
