"""Assembly of transitions from `/replay` into histories, from the first hand-over to the episode's end."""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.learning.transitions import usable
from vpsci_ros.world.transition import TRANSITION

STALE = 65536  # transitions; no world steps more episodes at once, so an open history gets one within so many


class HistoryAssembler:
    """Collects TRANSITION rows into one history an episode; a history with a missing row is dropped.

    :ivar consumed: number of the row that should come next.
    :ivar lost: rows that never came, by gaps in the numbers; rows lost after the last one received are not counted.
    :ivar refused: rows that are not `usable`.
    :ivar dropped: received rows that were dropped, since others of their history were lost or refused.
    """

    def __init__(self) -> None:
        self._open: dict[tuple[int, int], list[NDArray[np.void]]] = {}
        self.consumed = 0
        self.lost, self.dropped, self.refused = 0, 0, 0

    def add(self, transitions: NDArray[np.void]) -> list[NDArray[np.void]]:
        """Add rows TRANSITION[n] in the order of their numbers; return the completed histories, TRANSITION[T]."""
        finished = []
        for row, good in zip(transitions, usable(transitions), strict=True):
            number = int(row["number"])
            self.lost += max(0, number - self.consumed)
            self.consumed = number + 1
            if not good:
                self.refused += 1
                continue
            key = int(row["scenario"]), int(row["episode"])
            rows = self._open.setdefault(key, [])
            if row["step"] == 0:
                self.dropped += len(rows)
                rows.clear()
            if row["step"] != len(rows):
                self.dropped += len(rows) + 1
                del self._open[key]
                continue
            rows.append(row.copy())
            if row["last"]:
                finished.append(np.array(self._open.pop(key), TRANSITION))
        if self.lost or self.refused:
            self._drop_stale()
        return finished

    def _drop_stale(self) -> None:
        """Drop histories whose last row was lost or refused: nothing will end them."""
        for key, rows in list(self._open.items()):
            if self.consumed - int(rows[-1]["number"]) > STALE:
                self.dropped += len(rows)
                del self._open[key]
