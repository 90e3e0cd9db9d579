"""Many episodes that have ended, with what the filters say of each, for collector, filters, workers and files."""

import io
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput

QUANTITIES = (
    "position_x_av",
    "position_y_av",
    "velocity_x_av",
    "velocity_y_av",
    "position_x_ped",
    "position_y_ped",
    "velocity_x_ped",
    "velocity_y_ped",
    "distance",
    "CurvTTC",
)
KEPT = 0
REASONS = (
    "kept",
    "not critical",  # (1) CurvTTC never below 5 s
    "velocities missing",  # (2) ten frames in a row or more without them
    "too short",  # (3) fewer than 100 frames
    "vehicle hardly moved",  # (4) 10 m or less from the first to the last frame
    "pedestrian hardly moved",  # (4) 4 m or less
)
RECORD = np.dtype(
    [
        ("scenario", np.uint8),
        ("count", np.int64),  # number within the scenario
        ("outcome", np.uint8),  # of `vpsci_ros.world.state`
        ("failed", np.bool_, len(REASONS) - 1),  # the conditions `REASONS[1:]`, each on its own
        ("reason", np.uint8),  # index into `REASONS` of the first that fails in the paper's order, `KEPT` for none
        ("frames", np.int64),  # from the spawn to the end, both included
        ("pedestrians", np.int64),
        ("rows", np.int64),  # of the episode that are stored: a row a frame and pedestrian, or none
        ("least_curvttc", np.float32),  # [s] of all pairs
        ("vehicle_path", np.float64),  # [m] length of the trajectory, of the pair that decides
        ("pedestrian_path", np.float64),  # [m]
    ]
)
"""What is known of an episode that ended; `apply_filters` adds what the filters say."""


@dataclass(frozen=True)
class EpisodeBlock:
    """n episodes.

    :ivar records: RECORD[n].
    :ivar values: float32[rows, 10], `QUANTITIES` in map frame [m, m/s, s] of the episodes that are stored, one after
        the other, and in each one pedestrian after the other; NaN in frames that nobody saw.
    """

    records: NDArray[np.void]
    values: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.records)

    @property
    def kept(self) -> NDArray[np.bool_]:
        """bool[n], episodes that pass every filter."""
        return np.asarray(self.records["reason"] == KEPT)

    def only(self, chosen: NDArray[np.bool_]) -> "EpisodeBlock":
        """Return the episodes where bool[n] is true."""
        return EpisodeBlock(self.records[chosen], self.values[np.repeat(chosen, self.records["rows"])])

    def stored(self, keep_rejected: bool) -> "EpisodeBlock":
        """Return the episodes without the rows of rejected ones, unless these are kept, too."""
        stored, records = self.kept | keep_rejected, self.records.copy()
        records["rows"] = np.where(stored, records["rows"], 0)
        return EpisodeBlock(records, self.values[np.repeat(stored, self.records["rows"])])

    def write(self, file: BinaryIO) -> None:
        """Write the block as an NPZ file, each array with its checksum."""
        np.savez(file, records=self.records, values=self.values)

    def to_bytes(self) -> bytes:
        """Return what `write` writes."""
        file = io.BytesIO()
        self.write(file)
        return file.getvalue()


def joined(blocks: Sequence[EpisodeBlock]) -> EpisodeBlock:
    """Return the episodes of several blocks as one, in the order of their scenarios and numbers."""
    records = np.concatenate([np.zeros(0, RECORD), *(block.records for block in blocks)])
    values = np.concatenate([np.zeros((0, len(QUANTITIES)), np.float32), *(block.values for block in blocks)])
    order, ends = np.lexsort((records["count"], records["scenario"])), np.cumsum(records["rows"])
    if (order == np.arange(len(order))).all():
        return EpisodeBlock(records, values)
    rows = np.split(values, ends[:-1])
    return EpisodeBlock(records[order], np.concatenate([rows[i] for i in order]))


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
