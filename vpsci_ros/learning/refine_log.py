"""The logs of stage 2 in the graph of nodes, written during the training, whole or not at all."""

from pathlib import Path

from vpsci_ros.learning.online import EPISODES, LOG
from vpsci_ros.learning.pretrain import write_log
from vpsci_ros.learning.refine import Refiner

EPISODES_A_ROW = 20


class RefineLog:
    """Writes `refine_log.csv`, a row every `EPISODES_A_ROW` episodes, and `refine_episodes.csv` to `folder`.

    The rows are those of `online.refine`, without the rates of Table 5: a learner does not see how episodes end.
    """

    def __init__(self, refiner: Refiner, folder: Path) -> None:
        self._refiner, self._folder = refiner, folder
        self._rows: list[dict[str, float]] = []

    def note(self, last: bool = False) -> None:
        """Write the logs if a row is due, or at the `last` call if there is news; write nothing before an episode."""
        summary = self._refiner.summary()
        known = self._rows[-1] if self._rows else {"episodes": 0.0, "updates": 0.0}
        more = self._refiner.progress.episodes - known["episodes"]
        unsaid = more or (self._rows and summary["updates"] > known["updates"])
        if not (unsaid if last else more >= EPISODES_A_ROW):
            return
        self._rows.append(summary)
        self._folder.mkdir(parents=True, exist_ok=True)
        write_log(self._folder / LOG, self._rows)
        write_log(self._folder / EPISODES, self._refiner.progress.episode_returns)
