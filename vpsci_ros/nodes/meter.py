"""Rate and lag of a node's answers, for its diagnostics: a few additions an answer, arithmetic once a second."""

import time
from typing import Any

LARGEST_GAP = 100_000  # ticks


class Meter:
    """Counts a node's answers, the time that each took, and the ticks of the world that the node did not receive.

    These are figures of the machine by the wall clock, not of the episodes, and differ from run to run.
    """

    def __init__(self) -> None:
        self.count = 0
        self.missed = 0
        self._tick = -1
        self._spent = self._longest = 0.0
        self._reported = (time.perf_counter(), 0)

    def tick(self, tick: int) -> None:
        """Record a tick of the world; gaps between ticks count as missed ticks.

        A gap of more than `LARGEST_GAP` is not counted: the tick is another world's, or forged.
        """
        if self._tick >= 0 and 0 < tick - self._tick - 1 <= LARGEST_GAP:
            self.missed += tick - self._tick - 1
        self._tick = tick

    def answered(self, arrived: float) -> None:
        """Count an answer; `arrived` is the `time.perf_counter()` at which the answered message arrived."""
        took = time.perf_counter() - arrived
        self.count += 1
        self._spent += took
        self._longest = max(self._longest, took)

    def figures(self) -> dict[str, Any]:
        """Return tick, answers and missed ticks in all; since the last call answers/s, mean and longest lag [ms]."""
        now, (then, before) = time.perf_counter(), self._reported
        fresh = self.count - before
        mean, longest = self._spent / max(fresh, 1), self._longest
        self._reported, self._spent, self._longest = (now, self.count), 0.0, 0.0
        return {
            "tick": self._tick,
            "answers": self.count,
            "answers_per_second": round(fresh / max(now - then, 1e-9)),
            "lag_mean_ms": f"{1e3 * mean:.3f}",
            "lag_max_ms": f"{1e3 * longest:.3f}",
            "ticks_missed": self.missed,
        }
