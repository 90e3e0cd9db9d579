"""Episodes of one scenario that have ended, with what the filters say of each: what a dataset is written from.

A block is also what a worker sends and a journal keeps, so it goes into bytes and comes back.
"""

import dataclasses
import io
import itertools
import zipfile
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode_frames import QUANTITIES, EpisodeBatch
from vpsci_ros.data.filters import KEPT, REASONS, Judgement
from vpsci_ros.errors import InvalidInput


@dataclasses.dataclass(frozen=True)
class EpisodeBlock:
    """n episodes of one scenario.

    :ivar number: int64[n]; outcome, reason: uint8[n], codes of `vpsci_ros.world.state` and
        `vpsci_ros.data.filters.REASONS`; failed: bool[n, 5], each condition on its own.
    :ivar frames: int64[n]; least_curvttc: float32[n] [s]; vehicle_path, pedestrian_path: float64[n] [m].
    :ivar pedestrians: int64[n], how many an episode has.
    :ivar stored: bool[n], episodes whose frames are in `values`: the kept ones, or all.
    :ivar values: float32[rows, 10], `QUANTITIES` of the stored episodes, one after the other, and in each one
        pedestrian after the other.
    """

    number: NDArray[np.int64]
    outcome: NDArray[np.uint8]
    reason: NDArray[np.uint8]
    failed: NDArray[np.bool_]
    frames: NDArray[np.int64]
    least_curvttc: NDArray[np.float32]
    vehicle_path: NDArray[np.float64]
    pedestrian_path: NDArray[np.float64]
    pedestrians: NDArray[np.int64]
    stored: NDArray[np.bool_]
    values: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.number)

    @property
    def kept(self) -> NDArray[np.bool_]:
        """bool[n], episodes that pass every filter."""
        return self.reason == KEPT

    def starts(self) -> NDArray[np.int64]:
        """Return int64[n + 1], where each episode's rows begin in `values` (an empty range where not stored)."""
        return np.concatenate([[0], np.cumsum(np.where(self.stored, self.frames * self.pedestrians, 0))])

    def rows(self) -> list[NDArray[np.float32]]:
        """Return each episode's rows, float32[rows, 10] (none where not stored)."""
        starts = self.starts()
        return [self.values[begin:end] for begin, end in itertools.pairwise(starts)]

    def head(self, episodes: int) -> "EpisodeBlock":
        """Return the first `episodes` of them."""
        cut = {name: getattr(self, name)[:episodes] for name in _COLUMNS}
        return EpisodeBlock(**cut, values=self.values[: self.starts()[episodes]])

    def take(self, places: NDArray[np.int64]) -> "EpisodeBlock":
        """Return those at `places`, int64[m], in that order."""
        rows = self.rows()
        values = [np.zeros((0, len(QUANTITIES)), np.float32), *(rows[i] for i in places)]
        return EpisodeBlock(**{name: getattr(self, name)[places] for name in _COLUMNS}, values=np.concatenate(values))

    def to_bytes(self) -> bytes:
        """Return the block as an NPZ file, each array with its checksum."""
        file = io.BytesIO()
        np.savez(file, **{name: getattr(self, name) for name in (*_COLUMNS, "values")})
        return file.getvalue()


_COLUMNS = [field.name for field in dataclasses.fields(EpisodeBlock) if field.name != "values"]
NO_EPISODES = EpisodeBlock(
    number=np.zeros(0, np.int64),
    outcome=np.zeros(0, np.uint8),
    reason=np.zeros(0, np.uint8),
    failed=np.zeros((0, len(REASONS) - 1), np.bool_),
    frames=np.zeros(0, np.int64),
    least_curvttc=np.zeros(0, np.float32),
    vehicle_path=np.zeros(0, np.float64),
    pedestrian_path=np.zeros(0, np.float64),
    pedestrians=np.zeros(0, np.int64),
    stored=np.zeros(0, np.bool_),
    values=np.zeros((0, len(QUANTITIES)), np.float32),
)


def joined(blocks: Sequence[EpisodeBlock]) -> EpisodeBlock:
    """Return the episodes of several blocks as one, in the order of their numbers."""
    several = [NO_EPISODES, *blocks]
    columns = {name: np.concatenate([getattr(block, name) for block in several]) for name in _COLUMNS}
    order = np.argsort(columns["number"], kind="stable")
    rows = [episode for block in several for episode in block.rows()]
    values = np.concatenate([NO_EPISODES.values, *(rows[i] for i in order)])
    return EpisodeBlock(**{name: column[order] for name, column in columns.items()}, values=values)


def block_of(batch: EpisodeBatch, verdict: Judgement, keep_rejected: bool, scenario: int) -> EpisodeBlock:
    """Return the episodes of one scenario out of a batch that ended.

    :param verdict: what the filters say of the batch.
    :param keep_rejected: store the frames of rejected episodes, too.
    """
    first, pedestrians = batch.first, batch.pedestrians
    mine = batch.scenario[first] == scenario
    stored = mine & (keep_rejected | (verdict.reason == KEPT))
    of_pair = np.repeat(stored, pedestrians)
    shown = np.arange(batch.values.shape[1]) < (batch.frames * of_pair)[:, None]
    return EpisodeBlock(
        number=batch.episode[first][mine],
        outcome=batch.outcome[first][mine],
        reason=verdict.reason[mine],
        failed=verdict.failed[mine],
        frames=batch.frames[first][mine],
        least_curvttc=verdict.least_curvttc[mine],
        vehicle_path=verdict.vehicle_path[mine],
        pedestrian_path=verdict.pedestrian_path[mine],
        pedestrians=pedestrians[mine],
        stored=stored[mine],
        values=batch.values[shown],
    )


def block_from_bytes(data: bytes, where: str) -> EpisodeBlock:
    """Read a block; `where` opens the error messages.

    :raises InvalidInput: not a block, or damaged.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return EpisodeBlock(**{name: arrays[name] for name in (*_COLUMNS, "values")})
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InvalidInput(f"{where}: damaged part of a dataset: {error!r}; remove it and generate again") from None
