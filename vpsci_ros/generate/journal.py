"""What a run has finished so far, kept in the output folder, so that it goes on after Ctrl-C, a crash or a reboot.

The hidden folder `.generate` holds `run.json`, what the run is, and a file for each finished unit. A unit's file
appears whole, by a rename, so its presence is the journal's entry; a file that the disk has damaged is recognised by
its checksums and the unit computed again. The folder goes when the dataset is complete.
"""

import contextlib
import fcntl
import json
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.data.dataset_index import DESCRIPTION
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.job import Unit, fingerprint
from vpsci_ros.generate.part import Part, part_from_bytes
from vpsci_ros.provenance import require_empty_folder, written_whole

FOLDER = ".generate"
RUN = "run.json"


class Journal:
    """The journal of one run; use `journal_of` to open it.

    :ivar unit: episodes in a unit, as the run was begun with.
    """

    def __init__(self, folder: Path, unit: int) -> None:
        self._folder = folder
        self.unit = unit

    def path(self, unit: Unit) -> Path:
        """Return where a unit's part is or will be."""
        return self._folder / f"{unit.scenario}-{unit.numbers[0]:010d}.npz"

    def store(self, unit: Unit, data: bytes) -> None:
        """Note a finished unit."""
        with written_whole(self.path(unit)) as path:
            path.write_bytes(data)

    def load(self, unit: Unit) -> Part | None:
        """Return a unit's part; None where it is not finished, or damaged, which also removes it."""
        path = self.path(unit)
        if not path.is_file():
            return None
        try:
            part = part_from_bytes(path.read_bytes(), str(path))
        except InvalidInput:
            path.unlink()
            return None
        return part

    def finished(self, scenario: int) -> list[int]:
        """Return the first numbers of a scenario's finished units."""
        return sorted(int(path.stem.partition("-")[2]) for path in self._folder.glob(f"{scenario}-*.npz"))

    def remove(self) -> None:
        """Remove all of it: the dataset is complete."""
        shutil.rmtree(self._folder)


@contextlib.contextmanager
def journal_of(folder: Path, run: Mapping[str, Any], unit: int) -> Iterator[Journal | None]:
    """Open the journal of `run` in the output folder, begun or not; yields None where the run is complete.

    :param run: what the run is, as JSON values.
    :param unit: episodes in a unit, where the run begins now.
    :raises InvalidInput: the folder holds another run's work, or something else, or another process works in it.
    """
    if (folder / DESCRIPTION).is_file():
        _compare(_read(folder / DESCRIPTION), run, folder, "holds a dataset")
        shutil.rmtree(folder / FOLDER, ignore_errors=True)  # a run that was killed while it removed it
        yield None
        return
    hidden = folder / FOLDER
    if not hidden.is_dir():
        require_empty_folder(folder)
        hidden.mkdir()
    with (hidden / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InvalidInput(f"{folder}: another process is generating into this folder; wait for it") from None
        if (hidden / RUN).is_file():
            begun = _read(hidden / RUN)
            _compare(begun, run, folder, "holds an unfinished run")
            unit = int(begun["unit"])
        else:
            with written_whole(hidden / RUN) as path:
                path.write_text(json.dumps({**run, "unit": unit}, indent=2) + "\n", encoding="utf-8")
        yield Journal(hidden, unit)


def _read(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, TypeError) as error:
        raise InvalidInput(f"{path}: not readable ({error}); generate into another folder") from None


def _compare(found: Mapping[str, Any], run: Mapping[str, Any], folder: Path, what: str) -> None:
    """Refuse a folder whose run differs, naming the first difference."""
    stored = {name: found.get(name) for name in run}
    if fingerprint(stored) == fingerprint(run):
        return
    name, old, new = next(_differences(stored, json.loads(json.dumps(run)), ""))
    raise InvalidInput(
        f"{folder}: {what} with {name} = {old!r}, and this one has {new!r}; "
        "generate into another folder, or with the same configuration"
    )


def _differences(old: Any, new: Any, name: str) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*old, *(key for key in new if key not in old)]:
            yield from _differences(old.get(key), new.get(key), f"{name}.{key}" if name else key)
    elif old != new:
        yield name, old, new
