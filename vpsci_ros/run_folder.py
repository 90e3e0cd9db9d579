"""The folder of a run in this process: which parameters it has, and what they, its inputs and its outputs were.

`params.yaml` is there from the start, resolved, in the layout of a parameter file, so that the same command reproduces
the run from it. `run.json` is there from the moment that it ends or is stopped: how it ended, software versions, kind
of CPU, and the SHA-256 of every file that was read or written. `vpsci graph` leaves files of the same names.
"""

import json
import time
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any

import torch
import yaml

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import as_ros_parameters
from vpsci_ros.provenance import cpu_name, require_empty_folder, sha256, software_versions, written_whole

PARAMETERS, RECORD = "params.yaml", "run.json"
_GOES_ON = "checkpoint.safetensors"  # how the files end that a stopped run goes on from


class RunFolder:
    """The output folder of one run; use it in a `with` block, which writes the record however the run ends.

    :param folder: new, empty, of the same run, or holding a checkpoint that a graph of nodes left.
    :param sections: section -> resolved parameters.
    :param inputs: files that the run reads; their hashes go into the record.
    :param facts: further JSON values for the record.
    :raises InvalidInput: the folder holds something else, or the same run with other parameters.
    """

    def __init__(
        self,
        folder: Path,
        sections: dict[str, dict[str, Any]],
        inputs: Iterable[str | Path] = (),
        facts: dict[str, Any] | None = None,
    ) -> None:
        self._folder = folder
        self._begun = time.monotonic()
        self._facts = facts or {}
        self.results: dict[str, Any] = {}
        """What the run came to, JSON values; goes into the record."""
        parameters = folder / PARAMETERS
        text = yaml.safe_dump(as_ros_parameters(sections), sort_keys=False)
        if parameters.exists():
            _refuse_others(parameters, as_ros_parameters(sections))
        elif not any(folder.glob(f"*{_GOES_ON}")):
            require_empty_folder(folder)
        self._inputs = {str(path): sha256(path) for path in inputs}
        self.done = self._finished()
        """Whether the folder holds this run, finished, from the same inputs, with all that it left."""
        with written_whole(parameters) as part:
            part.write_text(text, encoding="utf-8")

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        record = {
            "error": "" if kind is None else str(error) or "stopped on request",
            "wall_time_sec": round(time.monotonic() - self._begun, 3),
            "results": self.results,
            "inputs_sha256": self._inputs,
            "outputs_sha256": {str(p.relative_to(self._folder)): sha256(p) for p in sorted(self._outputs())},
            "software": software_versions(),
            "cpu": cpu_name(),
            "torch_threads": torch.get_num_threads(),  # sums, and so last bits, depend on how many there are
        }
        with written_whole(self._folder / RECORD) as path:
            path.write_text(json.dumps(record | self._facts, indent=2) + "\n", encoding="utf-8")

    def _finished(self) -> bool:
        try:
            record = json.loads((self._folder / RECORD).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return False
        if not isinstance(record, dict) or record.get("error") != "" or record.get("inputs_sha256") != self._inputs:
            return False
        return all((self._folder / name).is_file() for name in record.get("outputs_sha256", ()))

    def _outputs(self) -> Iterable[Path]:
        for path in self._folder.rglob("*"):
            if path.is_file() and path.name != RECORD and not path.name.endswith((_GOES_ON, ".part")):
                yield path


def _refuse_others(path: Path, mine: dict[str, Any]) -> None:
    """Raise `InvalidInput` where the parameters in `path` are not `mine`, naming the first that differs."""
    try:
        theirs = yaml.safe_load(path.read_text(encoding="utf-8"))
        flat = [{(s, k): v for s in of for k, v in of[s]["ros__parameters"].items()} for of in (theirs, mine)]
    except (yaml.YAMLError, OSError, UnicodeDecodeError, TypeError, KeyError, AttributeError) as error:
        raise InvalidInput(f"{path}: not the parameters of a run: {error}; choose another output folder") from None
    for section, name in sorted(flat[0].keys() | flat[1].keys()):
        values = [side.get((section, name)) for side in flat]
        if values[0] != values[1]:
            raise InvalidInput(
                f"{path}: this folder holds a run with {section}.{name} = {values[0]}, expected {values[1]}; "
                "choose another output folder, or delete this one to start again"
            )
