"""The folder of a run: its parameters and the record of inputs and outputs.

`params.yaml` is there from the start, resolved, in the layout of a parameter file, so that the same command reproduces
the run from it. `run.json` is written when the run ends, fails or is stopped. `vpsci graph` leaves files of the same
names.
"""

import time
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any

from vpsci_ros.documents import dump_yaml, parse_yaml, read_yaml, reason
from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import as_ros_parameters, flat
from vpsci_ros.runs.files import FAILURE, require_empty_folder, sha256, write_text
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.journal import finished, hashes
from vpsci_ros.runs.record import RUN_RECORD, write_record
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.stop_request import uninterrupted

PARAMETERS = "params.yaml"
_GOES_ON = "checkpoint.safetensors"  # how the files end that a stopped run goes on from


class RunFolder:
    """The output folder of one run; use it in a `with` block, which writes the record however the run ends.

    :param folder: new, empty, of the same run, or holding the checkpoint of a node. A graph's `params.yaml` beside it
        is replaced; whether the checkpoint is of the same run is for its reader to check.
    :param sections: resolved parameters.
    :param inputs: files that the run reads; their hashes go into the record.
    :param facts: further JSON values for the record.
    :raises InvalidInput: the folder holds something else, or the same run with other parameters.
    """

    def __init__(
        self, folder: Path, sections: Sections, inputs: Iterable[str | Path] = (), facts: dict[str, Any] | None = None
    ) -> None:
        self._folder = folder
        self._begun = time.monotonic()
        self._facts = facts or {}
        parameters = folder / PARAMETERS
        text = dump_yaml(as_ros_parameters(sections.values))
        resumable = any(folder.glob(f"*{_GOES_ON}"))
        found = _values(parameters) if parameters.exists() else None
        if found is not None and not (resumable and "graph" in found):
            require_same(parameters, found, dict.fromkeys(found) | _flat(parse_yaml(text, str(parameters))))
        elif not resumable:
            require_empty_folder(folder)
        self.inputs = {str(path): sha256(path) for path in inputs}
        """SHA-256 of the files that the run reads, by path."""
        record = finished(folder / RUN_RECORD, {"error": "", "inputs_sha256": self.inputs})
        self.done = record is not None
        """Whether the folder holds this run, finished, from the same inputs, with all that it left."""
        self.results: dict[str, Any] = record.get("results", {}) if record else {}
        """What the run came to, or had come to where it is done; JSON values that go into the record."""
        write_text(parameters, text)

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        with uninterrupted():
            write_record(
                self._folder / RUN_RECORD,
                begun=self._begun,
                error="" if kind is None else str(error) or "stopped on request",
                results=self.results,
                inputs=self.inputs,
                outputs=hashes(self._folder, RUN_RECORD, FAILURE, _GOES_ON, ".part"),
                facts=self._facts,
            )


def _values(path: Path) -> dict[str, dict[str, Any]]:
    """Return section -> parameters of a run's `params.yaml`.

    :raises InvalidInput: `path` holds something else.
    """
    try:
        return _flat(read_yaml(path))
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InvalidInput(
            f"{path}: not the parameters of a run: {reason(error)}; choose another output folder"
        ) from None


def _flat(layout: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {name: flat(section["ros__parameters"]) for name, section in layout.items()}
