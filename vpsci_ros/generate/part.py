"""What comes of a unit: its episodes in the order of their numbers, and the bytes that carry them about."""

import dataclasses
import io
import zipfile
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode_frames import QUANTITIES, EpisodeBatch
from vpsci_ros.data.filters import KEPT, REASONS, Judgement
from vpsci_ros.errors import InvalidInput


@dataclasses.dataclass(frozen=True)
class Part:
    """n episodes of one scenario, in the order of their numbers.

    :ivar number: int64[n]; outcome, reason: uint8[n], codes of `vpsci_ros.world.state` and
        `vpsci_ros.data.filters.REASONS`; failed: bool[n, 5], each condition on its own.
    :ivar frames: int64[n]; least_curvttc: float32[n] [s]; vehicle_path, pedestrian_path: float64[n] [m].
    :ivar stored: bool[n], episodes whose frames are in `values`: the kept ones, or all.
    :ivar values: float32[rows, 10], `QUANTITIES` of the stored episodes, one after the other, and in each one
        pedestrian after the other.
    :ivar pedestrians: int64[n], how many an episode has.
    """

    number: NDArray[np.int64]
    outcome: NDArray[np.uint8]
    reason: NDArray[np.uint8]
    failed: NDArray[np.bool_]
    frames: NDArray[np.int64]
    least_curvttc: NDArray[np.float32]
    vehicle_path: NDArray[np.float64]
    pedestrian_path: NDArray[np.float64]
    stored: NDArray[np.bool_]
    values: NDArray[np.float32]
    pedestrians: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.number)

    @property
    def kept(self) -> NDArray[np.bool_]:
        """bool[n], episodes that pass every filter."""
        return self.reason == KEPT

    def starts(self) -> NDArray[np.int64]:
        """Return int64[n + 1], where each episode's rows begin in `values` (an empty range where not stored)."""
        return np.concatenate([[0], np.cumsum(np.where(self.stored, self.frames * self.pedestrians, 0))])

    def head(self, episodes: int) -> "Part":
        """Return the first `episodes` of them."""
        cut = {f.name: getattr(self, f.name)[:episodes] for f in dataclasses.fields(self) if f.name != "values"}
        return Part(**cut, values=self.values[: self.starts()[episodes]])

    def to_bytes(self) -> bytes:
        """Return the part as an NPZ file, each array with its checksum."""
        file = io.BytesIO()
        np.savez(file, **{field.name: getattr(self, field.name) for field in dataclasses.fields(self)})
        return file.getvalue()


def part_from_bytes(data: bytes, where: str) -> Part:
    """Read a part; `where` opens the error messages.

    :raises InvalidInput: not a part, or damaged.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return Part(**{field.name: arrays[field.name] for field in dataclasses.fields(Part)})
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InvalidInput(f"{where}: damaged part of a dataset: {error!r}; remove it and generate again") from None


class PartCollector:
    """Takes episodes as they end, in any order, and makes the part of them."""

    def __init__(self, keep_rejected: bool) -> None:
        self._keep_rejected = keep_rejected
        self._batches: list[tuple[EpisodeBatch, Judgement]] = []
        self._values: list[NDArray[np.float32]] = []

    def add(self, batch: EpisodeBatch, verdict: Judgement) -> None:
        """Take episodes that have ended."""
        for i, (first, pedestrians) in enumerate(zip(batch.first, batch.pedestrians, strict=True)):
            stored = self._keep_rejected or verdict.reason[i] == KEPT
            self._values.append(batch.rows(first, pedestrians if stored else 0).copy())
        empty = np.zeros((0, 0, len(QUANTITIES)), np.float32)
        self._batches.append((dataclasses.replace(batch, values=empty), verdict))

    def part(self) -> Part:
        """Return all of them, in the order of their numbers."""
        batches, verdicts = [b for b, _ in self._batches], [v for _, v in self._batches]
        number = _joined([b.episode[b.first] for b in batches], np.int64)
        order = np.argsort(number, kind="stable")
        reason = _joined([v.reason for v in verdicts], np.uint8)[order]
        failed = [np.zeros((0, len(REASONS) - 1), np.bool_), *(v.failed for v in verdicts)]
        values = [np.zeros((0, len(QUANTITIES)), np.float32), *(self._values[i] for i in order)]
        return Part(
            number=number[order],
            outcome=_joined([b.outcome[b.first] for b in batches], np.uint8)[order],
            reason=reason,
            failed=np.concatenate(failed)[order],
            frames=_joined([b.frames[b.first] for b in batches], np.int64)[order],
            least_curvttc=_joined([v.least_curvttc for v in verdicts], np.float32)[order],
            vehicle_path=_joined([v.vehicle_path for v in verdicts], np.float64)[order],
            pedestrian_path=_joined([v.pedestrian_path for v in verdicts], np.float64)[order],
            stored=(reason == KEPT) | self._keep_rejected,
            values=np.concatenate(values),
            pedestrians=_joined([b.pedestrians for b in batches], np.int64)[order],
        )


def _joined(arrays: Sequence[NDArray[Any]], dtype: type[np.generic]) -> NDArray[Any]:
    return np.concatenate([np.zeros(0, dtype), *arrays])
