"""The record `run.json` of a run: how it ended, its inputs, outputs, results and software."""

import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.documents import read_json
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import write_json
from vpsci_ros.runs.provenance import cpu_name, software_versions

RUN_RECORD = "run.json"


def write_record(
    path: Path,
    *,
    begun: float,
    error: str = "",
    results: Mapping[str, Any],
    inputs: Mapping[str, str],
    outputs: Mapping[str, str] | None = None,
    facts: Mapping[str, Any] | None = None,
) -> None:
    """Write the record of a run to `path`, as JSON.

    :param begun: `time.monotonic()` at the beginning of the run.
    :param error: why the run did not reach its end; empty: it did.
    :param results: what the run came to, JSON values.
    :param inputs, outputs: SHA-256 of the files that were read and written, by path or name.
    :param facts: further JSON values.
    """
    torch = sys.modules.get("torch")  # a run that never needed it does not load it to say so
    record = {
        "error": error,
        "wall_time_sec": round(time.monotonic() - begun, 3),
        "results": dict(results),
        "inputs_sha256": dict(inputs),
        "outputs_sha256": dict(outputs or {}),
        "software": software_versions(),
        "cpu": cpu_name(),
        "torch_threads": torch.get_num_threads() if torch else None,  # sums, and so last bits, depend on their number
    }
    write_json(path, record | dict(facts or {}))


def read_record(path: Path) -> dict[str, Any] | None:
    """Return the record of a run from `path`; None if it is missing or unreadable."""
    try:
        record = read_json(path)
    except InvalidInput:
        return None
    return record if isinstance(record, dict) and {"error", "results", "inputs_sha256"} <= record.keys() else None
