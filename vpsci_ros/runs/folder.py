"""The folder of a run in this process: which parameters it has, and what they, its inputs and its outputs were.

`params.yaml` is there from the start, resolved, in the layout of a parameter file, so that the same command reproduces
the run from it. `run.json` is there from the moment that it ends or is stopped. `vpsci graph` leaves files
of the same names.
"""

import contextlib
import fcntl
import json
import os
import sys
import time
import weakref
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from vpsci_ros.documents import dump_yaml, parse_yaml, read_json, read_yaml, reason
from vpsci_ros.errors import InvalidInput, VpsciError, in_words
from vpsci_ros.parameters import as_ros_parameters, flat
from vpsci_ros.runs.config import Sections
from vpsci_ros.runs.files import (
    CLAIMED,
    FAILURE,
    changed_files,
    is_at,
    is_empty_folder,
    remove_parts,
    require_claimed,
    require_empty_folder,
    sha256,
    write_json,
    write_text,
)
from vpsci_ros.runs.provenance import cpu_name, software_versions
from vpsci_ros.runs.stop_request import uninterrupted

# ---- Whether a folder holds the same run: one check, with one error, for every command that goes on with a run.


_LONGEST = 200  # characters of a value that an error message quotes
_ADVICE = "choose another output folder, or delete it to start again"


def require_same(
    where: object,
    found: Mapping[str, Any],
    mine: Mapping[str, Any],
    what: str = "holds a run",
    advice: str = _ADVICE,
) -> None:
    """Refuse to go on with what another run left.

    :param where: the file or folder that was found, the opening of the error message.
    :param found: what that run was, as JSON values; names that `mine` lacks do not count.
    :param mine: what this run is; anything that JSON can write.
    :raises InvalidInput: they differ; the first difference is named.
    """
    found = {name: found.get(name) for name in mine}
    for name, old, new in _differences(found, json.loads(json.dumps(mine)), ""):
        raise InvalidInput(f"{where}: {what} with {name} = {_quoted(old)}, and this one has {_quoted(new)}; {advice}")


def _differences(old: Any, new: Any, name: str) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys([*old, *new]):
            yield from _differences(old.get(key), new.get(key), f"{name}.{key}" if name else key)
    elif old != new:
        yield name, old, new


def _quoted(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


# ---- The record that every run leaves beside its results: how it ended, from what, by what, and what it came to.


RECORD = "run.json"


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
    """Write a record as `path`.

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
    """Return a record; None where there is none, or none that can be read."""
    try:
        record = read_json(path)
    except InvalidInput:
        return None
    return record if isinstance(record, dict) and {"error", "results", "inputs_sha256"} <= record.keys() else None


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
        self.results: dict[str, Any] = {}
        """What the run came to, or had come to where it is done; JSON values that go into the record."""
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
        self.done = self._finished()
        """Whether the folder holds this run, finished, from the same inputs, with all that it left."""
        write_text(parameters, text)

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        with uninterrupted():
            write_record(
                self._folder / RECORD,
                begun=self._begun,
                error="" if kind is None else str(error) or "stopped on request",
                results=self.results,
                inputs=self.inputs,
                outputs={str(path.relative_to(self._folder)): sha256(path) for path in sorted(self._outputs())},
                facts=self._facts,
            )

    def _finished(self) -> bool:
        record = read_record(self._folder / RECORD)
        if record is None or record["error"] or record["inputs_sha256"] != self.inputs:
            return False
        if changed_files(self._folder, record.get("outputs_sha256", {})):
            return False
        self.results = record["results"]
        return True

    def _outputs(self) -> Iterable[Path]:
        for path in self._folder.rglob("*"):
            if path.is_file() and path.name not in (RECORD, FAILURE) and not path.name.endswith((_GOES_ON, ".part")):
                yield path


def _values(path: Path) -> dict[str, dict[str, Any]]:
    """Return the sections of a run's parameters.

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


# ---- Output folders: nobody else's while they are written, and marked where a command left them unfinished.


class Claim:
    """A folder that is this process's from now on until `close`; the system ends the claim of a process that dies.

    :param path: made if need be.
    :raises InvalidInput: it is no folder, or another process has claimed it.
    :raises VpsciError: it lies in an output folder that was deleted, moved or replaced.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        require_claimed(self.path)
        self.made = not self.path.exists()
        if not self.made and not self.path.is_dir():
            require_empty_folder(self.path)  # says that it is no folder
        self.path.mkdir(parents=True, exist_ok=True)
        handle = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY)
        status = os.fstat(handle)
        self._identity = status.st_dev, status.st_ino
        self._first = self._identity not in CLAIMED
        self.close = weakref.finalize(self, _release, handle, self._identity if self._first else None)
        """Give the folder up."""
        if self._first:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                self.close()
                raise InvalidInput(
                    f"{self.path}: another process is writing into this folder; wait for it, or choose another one"
                ) from None
            except OSError:  # a file system without locks
                pass
            CLAIMED[self._identity] = self.path.absolute()

    @property
    def there(self) -> bool:
        """Whether the path still names the folder that was claimed."""
        return is_at(self._identity, self.path)

    def require_there(self) -> None:
        """Refuse to go on by a path that names something else by now.

        :raises VpsciError: the folder was deleted, moved or replaced.
        """
        if not self.there:
            raise VpsciError(f"{self.path}: this folder was deleted, moved or replaced while it was being written")


def _release(handle: int, identity: tuple[int, int] | None) -> None:
    if identity is not None:
        CLAIMED.pop(identity, None)
    os.close(handle)


@contextlib.contextmanager
def output_folder(path: Path) -> Iterator[Claim]:
    """Claim the folder that a command writes, and mark what it leaves there where it fails.

    The mark, `FAILURE` with the reason, is written where no record describes the failure, and removed when the same
    command succeeds, with what an earlier one left half written when it was killed. A folder that stays empty is
    removed again.

    :raises InvalidInput: see `Claim`.
    :raises VpsciError: the folder was taken away meanwhile.
    """
    begun, claim = time.monotonic(), Claim(path)
    try:
        empty = is_empty_folder(path)
        yield claim
        claim.require_there()
        (path / FAILURE).unlink(missing_ok=True)
        remove_parts(path)
    except BaseException as error:
        claim.require_there()
        refused = isinstance(error, InvalidInput) and not empty
        if not (refused or is_empty_folder(path)):
            _mark(path, begun, in_words(error) or str(error) or "stopped on request")
        raise
    finally:
        if claim.there and claim.made and not any(path.iterdir()):
            path.rmdir()
        claim.close()


def _mark(folder: Path, begun: float, error: str) -> None:
    record = read_record(folder / RECORD)
    if record is None or not record["error"]:
        with contextlib.suppress(OSError, VpsciError):
            write_record(folder / FAILURE, begun=begun, error=error, results={}, inputs={})
