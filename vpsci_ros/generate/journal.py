"""Finished units of a run, kept in the output folder, so that it resumes after Ctrl-C, a crash or a reboot.

The hidden folder `.generate` has `run.json`, the identity of the run, and a file for each finished unit. A unit's file
appears whole, by a rename. Damaged units fail their checksum and are recomputed. The folder is removed when the dataset
is complete and its record written.
"""

import contextlib
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.data.dataset_index import DESCRIPTION
from vpsci_ros.data.episode_block import EpisodeBlock, block_from_bytes
from vpsci_ros.documents import read_json, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.job import Unit
from vpsci_ros.runs.files import require_empty_folder, write_json, written_whole
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.output_folder import Claim

FOLDER, RECORD = ".generate", "generation.json"
RUN = "run.json"


class Journal:
    """The journal of one run; use `journal_of` to open it.

    :ivar unit: episodes in a unit of this run.
    """

    def __init__(self, folder: Path, unit: int) -> None:
        self._folder = folder
        self.unit = unit

    def path(self, unit: Unit) -> Path:
        """Return the path of a unit's file."""
        return self._folder / f"{unit.scenario}-{unit.numbers[0]:010d}.npz"

    def store(self, unit: Unit, data: bytes) -> None:
        """Write a finished unit."""
        with written_whole(self.path(unit)) as path:
            path.write_bytes(data)

    def load(self, unit: Unit) -> EpisodeBlock | None:
        """Return a unit's episodes; None for an unfinished or damaged one, which is removed."""
        path = self.path(unit)
        if not path.is_file():
            return None
        try:
            return block_from_bytes(path.read_bytes(), str(path))
        except InvalidInput:
            path.unlink()
            return None

    def finished(self, scenario: int) -> list[int]:
        """Return the first numbers of a scenario's finished units."""
        return sorted(int(path.stem.partition("-")[2]) for path in self._folder.glob(f"{scenario}-*.npz"))

    def remove(self) -> None:
        """Remove the journal of a complete dataset."""
        shutil.rmtree(self._folder)


@contextlib.contextmanager
def journal_of(folder: Path, run: Mapping[str, Any], unit: int) -> Iterator[Journal | None]:
    """Open the journal of `run` in the output folder, begun or not; yields None where the run is complete.

    :param run: identity of the run, as JSON values.
    :param unit: episodes in a unit of a new run.
    :raises InvalidInput: the folder has another content, or another process uses it.
    """
    if (folder / DESCRIPTION).is_file() and ((folder / RECORD).is_file() or not (folder / FOLDER).is_dir()):
        require_same(folder, _read(folder / DESCRIPTION), run, "holds a dataset")
        shutil.rmtree(folder / FOLDER, ignore_errors=True)  # a run that was killed while it removed it
        yield None
        return
    with contextlib.closing(Claim(folder)):
        hidden = folder / FOLDER
        if not hidden.is_dir():
            require_empty_folder(folder)
            hidden.mkdir()
        if (hidden / RUN).is_file():
            begun = _read(hidden / RUN)
            require_same(folder, begun, run, "holds an unfinished run")
            unit = int(begun["unit"])
        else:
            write_json(hidden / RUN, {**run, "unit": unit})
        yield Journal(hidden, unit)


def _read(path: Path) -> dict[str, Any]:
    found = read_json(path)
    require_form(found, dict, f"{path}: not what a run writes; generate into another folder")
    return dict(found)
