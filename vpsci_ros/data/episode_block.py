"""Episodes of one scenario that have ended, with what the filters say of each: what a dataset is written from.

A block is also what a worker sends and a journal keeps, so it goes into bytes and comes back.
"""

import io
import itertools
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode_frames import QUANTITIES, EpisodeBatch
from vpsci_ros.data.filters import KEPT, RECORD
from vpsci_ros.errors import InvalidInput


@dataclass(frozen=True)
class EpisodeBlock:
    """n episodes of one scenario.

    :ivar records: RECORD[n], see `vpsci_ros.data.filters`.
    :ivar values: float32[rows, 10], `QUANTITIES` of the stored episodes (the kept ones, or all), one after the other,
        and in each one pedestrian after the other.
    """

    records: NDArray[np.void]
    values: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.records)

    @property
    def kept(self) -> NDArray[np.bool_]:
        """bool[n], episodes that pass every filter."""
        return np.asarray(self.records["reason"] == KEPT)

    def rows(self) -> list[NDArray[np.float32]]:
        """Return each episode's rows, float32[rows, 10] (none where not stored)."""
        ends = itertools.accumulate(self.records["rows"].tolist(), initial=0)
        return [self.values[begin:end] for begin, end in itertools.pairwise(ends)]

    def take(self, places: NDArray[np.int64]) -> "EpisodeBlock":
        """Return those at `places`, int64[m], in that order."""
        rows = self.rows()
        return EpisodeBlock(self.records[places], np.concatenate([NO_ROWS, *(rows[i] for i in places)]))

    def write(self, file: BinaryIO) -> None:
        """Write the block as an NPZ file, each array with its checksum."""
        np.savez(file, records=self.records, values=self.values)

    def to_bytes(self) -> bytes:
        """Return what `write` writes."""
        file = io.BytesIO()
        self.write(file)
        return file.getvalue()


NO_ROWS = np.zeros((0, len(QUANTITIES)), np.float32)


def joined(blocks: Sequence[EpisodeBlock]) -> EpisodeBlock:
    """Return the episodes of several blocks as one, in the order of their numbers."""
    records = np.concatenate([np.zeros(0, RECORD), *(block.records for block in blocks)])
    rows = [own for block in blocks for own in block.rows()]
    order = np.argsort(records["count"], kind="stable")
    return EpisodeBlock(records[order], np.concatenate([NO_ROWS, *(rows[i] for i in order)]))


def block_of(batch: EpisodeBatch, records: NDArray[np.void], keep_rejected: bool, scenario: int) -> EpisodeBlock:
    """Return the episodes of one scenario out of a batch that ended.

    :param records: RECORD[m], what the filters say of the batch.
    :param keep_rejected: store the frames of rejected episodes, too.
    """
    records = records.copy()
    stored = (records["scenario"] == scenario) & (keep_rejected | (records["reason"] == KEPT))
    records["rows"] = np.where(stored, records["frames"] * records["pedestrians"], 0)
    of_pair = np.repeat(stored, records["pedestrians"])
    shown = np.arange(batch.values.shape[1]) < (batch.frames * of_pair)[:, None]
    return EpisodeBlock(records[records["scenario"] == scenario], batch.values[shown])


def block_from_bytes(data: bytes, where: str) -> EpisodeBlock:
    """Read a block; `where` opens the error messages.

    :raises InvalidInput: not a block, or damaged.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            records, values = arrays["records"], arrays["values"]
        if records.dtype != RECORD:
            raise ValueError(f"expected records of {RECORD}, got {records.dtype}")
        return EpisodeBlock(records, values)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InvalidInput(f"{where}: damaged part of a dataset: {error!r}; remove it and generate again") from None
