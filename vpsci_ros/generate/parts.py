"""The parts of an unfinished dataset: a Parquet file for each finished unit of work; a stopped run resumes from them.

The hidden folder `.generate` in the output folder has `run.json`, the identity of the run, and the parts. A part has
the rows of its episodes as the dataset has them, uncompressed, and the records of all episodes in its schema. It
appears whole, by a rename. A damaged one fails its checksums and its unit is computed again. The folder is removed when
the dataset is complete and its record written.
"""

import contextlib
import shutil
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vpsci_ros.data.dataset_description import DESCRIPTION
from vpsci_ros.data.dataset_tables import DATASET_COLUMNS, arrow_rows
from vpsci_ros.data.episode_block import JUDGED, EpisodeBlock
from vpsci_ros.data.parquet import read_metadata
from vpsci_ros.documents import read_json, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.job import Unit
from vpsci_ros.runs.files import atomic_write, require_empty_folder, write_json
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.output_folder import FolderLock

FOLDER, RUN, FINISHED = ".generate", "run.json", "generation.json"
_NUMBERS = [name for name, column in DATASET_COLUMNS.items() if column.dtype.is_integer()]


def write_part(path: Path, block: EpisodeBlock) -> None:
    """Write the part of a unit: its episodes, in the order of their numbers."""
    records = block.records.tobytes()
    rows = arrow_rows(block, records=records.hex(), checksum=zlib.crc32(records))
    with atomic_write(path) as part:
        pq.write_table(rows, part, compression="none", use_dictionary=_NUMBERS, write_page_checksum=True)


def read_part(path: Path) -> tuple[NDArray[np.void], pa.Table]:
    """Return the records of a unit's episodes, JUDGED[n], and the rows of those that are stored.

    :raises InvalidInput: no part, or a damaged one.
    """
    try:
        stored = read_metadata(path)
        data = bytes.fromhex(stored["records"])
        records = np.frombuffer(data, JUDGED)
        rows = pq.read_table(path, page_checksum_verification=True)
        if zlib.crc32(data) != stored["checksum"] or rows.num_rows != records["rows"].sum():
            raise ValueError("its records are not those that were written")
        return records, rows
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        raise InvalidInput(f"{path}: damaged part of a dataset: {error!r}; remove it and generate again") from None


class Parts:
    """The parts of one run; use `parts_of` to open them.

    :ivar unit: episodes in a unit of this run.
    """

    def __init__(self, folder: Path, unit: int) -> None:
        self._folder = folder
        self.unit = unit

    def path(self, unit: Unit) -> Path:
        """Return the path of a unit's part."""
        return self._folder / f"{unit.scenario}-{unit.numbers[0]:010d}.parquet"

    def load(self, unit: Unit) -> tuple[NDArray[np.void], pa.Table] | None:
        """Return a unit's records and rows; None if it is unfinished or its part damaged; a damaged part is removed."""
        path = self.path(unit)
        if not path.is_file():
            return None
        try:
            return read_part(path)
        except InvalidInput:
            path.unlink()
            return None

    def finished(self, scenario: int) -> list[int]:
        """Return the first numbers of a scenario's finished units."""
        return sorted(int(path.stem.partition("-")[2]) for path in self._folder.glob(f"{scenario}-*.parquet"))

    def remove(self) -> None:
        """Remove the parts of a complete dataset."""
        shutil.rmtree(self._folder)


@contextlib.contextmanager
def parts_of(folder: Path, run: Mapping[str, Any], unit: int) -> Iterator[Parts | None]:
    """Open the parts of a new or resumed `run` in the output folder; yield None if the run is complete.

    :param run: identity of the run, as JSON values.
    :param unit: episodes in a unit of a new run.
    :raises InvalidInput: the folder has another content, or another process uses it.
    """
    if (folder / DESCRIPTION).is_file() and ((folder / FINISHED).is_file() or not (folder / FOLDER).is_dir()):
        require_same(folder, _read(folder / DESCRIPTION), run, "holds a dataset")
        shutil.rmtree(folder / FOLDER, ignore_errors=True)  # a run that was killed while it removed it
        yield None
        return
    with contextlib.closing(FolderLock(folder)):
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
        yield Parts(hidden, unit)


def _read(path: Path) -> dict[str, Any]:
    found = read_json(path)
    require_form(found, dict, f"{path}: not what a run writes; generate into another folder")
    return dict(found)
