"""Transitions become histories again: rows of one episode from the hand-over to where control is given back."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.learning.replay import History
from vpsci_ros.learning.rewards import EventRewards
from vpsci_ros.learning.transitions import TRANSITION, usable
from vpsci_ros.world.observation import AGENTS

STALE = 65536  # transitions; no world steps more episodes at once, so an open history gets one within so many


class HistoryAssembler:
    """Collects TRANSITION rows by episode; a history with a missing step is dropped, since its state is unknown.

    received counts rows, lost those that never came by the gaps in their numbers (so not those after the last one that
    came), refused those that are not `usable`, dropped the rows that came but were thrown away since others of their
    history were lost or refused. consumed is the number of the row that should come next.

    :param rewards: (25) and (26) of the steps of a history.
    """

    def __init__(self, rewards: EventRewards) -> None:
        self._rewards = rewards
        self._open: dict[tuple[int, int], list[NDArray[np.void]]] = {}
        self.consumed = 0
        self.received, self.lost, self.dropped, self.refused = 0, 0, 0, 0

    def add(self, transitions: NDArray[np.void]) -> list[History]:
        """Take rows in, TRANSITION[n] in the order of their numbers, and return the histories that they complete."""
        finished = []
        for row, good in zip(transitions, usable(transitions), strict=True):
            number = int(row["number"])
            self.lost += max(0, number - self.consumed)
            self.consumed = number + 1
            self.received += 1
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
                finished.append(self._history(np.array(self._open.pop(key), TRANSITION)))
        if self.lost or self.refused:
            self._drop_stale()
        return finished

    def _drop_stale(self) -> None:
        """Drop histories whose last row was lost or refused: nothing will end them."""
        for key, rows in list(self._open.items()):
            if self.consumed - int(rows[-1]["number"]) > STALE:
                self.dropped += len(rows)
                del self._open[key]

    def _history(self, rows: NDArray[np.void]) -> History:
        return History(
            {a: np.concatenate([rows[f"{a}_observation"], rows[f"next_{a}_observation"][-1:]]) for a in AGENTS},
            np.append(rows["curvttc"], rows["next_curvttc"][-1]),
            {a: rows[f"{a}_action"].copy() for a in AGENTS},  # a view of one record has odd strides
            {a: np.zeros((len(rows), 2), np.float32) for a in AGENTS},
            {a: self._rewards.of(rows["collision"], rows[f"{a}_goal"]) for a in AGENTS},
            terminal=bool(rows["terminal"][-1]),
            real=False,
            lane=rows["lane_heading"].copy(),
        )

    def state(self) -> dict[str, Any]:
        """Return all that `restore` needs."""
        rows = [np.array(part, TRANSITION).view(np.uint8) for part in self._open.values() if part]
        counters = [self.consumed, self.received, self.lost, self.dropped]
        taken = np.concatenate(rows) if rows else np.zeros(0, np.uint8)
        return {"rows": taken, "counters": counters, "refused": self.refused}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from `state`."""
        self._open = {}
        for row in state["rows"].view(TRANSITION):
            self._open.setdefault((int(row["scenario"]), int(row["episode"])), []).append(row.copy())
        self.consumed, self.received, self.lost, self.dropped = state["counters"]
        self.refused = state.get("refused", 0)  # checkpoints of earlier versions do not have it
