"""The parts of an unfinished dataset: a file for each finished unit of work; a stopped run resumes from them.

The hidden folder `.generate` in the output folder has `run.json`, the identity of the run, and the parts, each an item
of `runs.journal` that holds the unit's block: the number of its records, the records, and the values column by column,
compressed. The unit of a part that is damaged, or another unit's or run's, is computed again. The folder is removed
when the dataset is complete and its record written.
"""

import contextlib
import json
import re
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from vpsci_ros.data.dataset_description import DESCRIPTION
from vpsci_ros.data.episode import QUANTITIES
from vpsci_ros.data.episode_block import JUDGED, EpisodeBlock
from vpsci_ros.generate.job import Unit
from vpsci_ros.generate.plan import DatasetPlan
from vpsci_ros.runs.files import require_empty_folder, write_json
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.journal import read_item, stored_work, write_item
from vpsci_ros.runs.output_folder import FolderLock

FOLDER, RUN, FINISHED = ".generate", "run.json", "generation.json"
WANTED = "kept_wanted"  # of the identity of a run: kept episodes by scenario
_CODEC = "lz4"


class Parts:
    """The parts of one run; use `parts_of` to open them.

    :ivar folder: in which the parts lie.
    :ivar unit: episodes in a unit of this run.
    :ivar run: identity of the run as text.
    """

    def __init__(self, folder: Path, unit: int, run: str) -> None:
        self.folder = folder
        self.unit = unit
        self.run = run

    def at(self, folder: Path) -> "Parts":
        """Return this run's parts in another folder."""
        return Parts(folder, self.unit, self.run)

    def _bound(self, unit: Unit) -> bytes:
        return f"{self.run} {unit.scenario} {unit.numbers[0]} {len(unit.numbers)}".encode()

    def write(self, unit: Unit, block: EpisodeBlock) -> None:
        """Write the part of a unit: its episodes, in the order of their numbers, with float32 values."""
        values = pa.compress(block.values.tobytes("F"), _CODEC, asbytes=True)
        data = len(block).to_bytes(8, "little") + block.records.tobytes() + values
        write_item(self.path(unit), self._bound(unit), data)

    def path(self, unit: Unit) -> Path:
        """Return the path of a unit's part."""
        return self.folder / f"{unit.scenario}-{unit.numbers[0]:010d}.block"

    def load(self, unit: Unit) -> EpisodeBlock | None:
        """Return a unit's block; None if it is unfinished or its part damaged; a damaged part is removed."""
        if (data := read_item(self.path(unit), self._bound(unit))) is None:
            self.path(unit).unlink(missing_ok=True)
            return None
        end = 8 + int.from_bytes(data[:8], "little") * JUDGED.itemsize
        records = np.frombuffer(data[8:end], JUDGED)
        size = int(records["rows"].sum()) * len(QUANTITIES)
        values = pa.decompress(pa.py_buffer(data[end:]), 4 * size, _CODEC)
        return EpisodeBlock(records, np.frombuffer(values, np.float32).reshape(len(QUANTITIES), -1).T)

    def files(self, plan: DatasetPlan) -> Iterator[tuple[Path, Unit | None]]:
        """Yield each file among the parts with its unit in a plan; None: it is no part of this run."""
        for path in sorted(self.folder.iterdir()):
            if path.name != RUN and not path.name.startswith("."):
                name = re.fullmatch(r"(\d+)-(\d{10})\.block", path.name)
                scenario = plan.scenarios.get(int(name[1])) if name else None
                yield path, scenario.unit_from(int(name[2])) if name and scenario else None

    def remove(self) -> None:
        """Remove the parts of a complete dataset."""
        shutil.rmtree(self.folder)


@contextlib.contextmanager
def parts_of(folder: Path, run: Mapping[str, Any], unit: int) -> Iterator[Parts | None]:
    """Open the parts of a new, resumed or extended `run` in the output folder; yield None if the run is complete.

    A run is extended where the folder has the same run, finished or not, for fewer kept episodes.

    :param run: identity of the run, as JSON values.
    :param unit: episodes in a unit of a new run.
    :raises InvalidInput: the folder has another content, or another process uses it.
    """
    own = {name: value for name, value in run.items() if name != WANTED}
    extended = False
    if (folder / DESCRIPTION).is_file() and ((folder / FINISHED).is_file() or not (folder / FOLDER).is_dir()):
        found = stored_work(folder / DESCRIPTION)
        extended = _more(found.get(WANTED), run[WANTED])
        require_same(folder, found, own if extended else run, "holds a dataset")
        if not extended:
            shutil.rmtree(folder / FOLDER, ignore_errors=True)  # a run that was killed while it removed it
            yield None
            return
    with contextlib.closing(FolderLock(folder)):
        hidden = folder / FOLDER
        if not hidden.is_dir():
            if not extended:
                require_empty_folder(folder)
            hidden.mkdir()
        if (hidden / RUN).is_file():
            begun = stored_work(hidden / RUN)
            require_same(folder, begun, own, "holds an unfinished run")
            unit = int(begun["unit"])
        write_json(hidden / RUN, {**run, "unit": unit})
        yield Parts(hidden, unit, json.dumps(own, sort_keys=True))


def _more(found: Any, wanted: Mapping[str, int]) -> bool:
    """Return whether more kept episodes are wanted than a dataset has of the same scenarios, and nowhere fewer."""
    return (
        isinstance(found, dict)
        and found.keys() == wanted.keys()
        and found != wanted
        and all(found[number] <= wanted[number] for number in wanted)
    )
