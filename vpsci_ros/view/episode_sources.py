"""Episodes of a near-miss table, a dataset or a bag: listed by name, and read from disk.

A dataset and a bag contain their own scenarios: an episode takes its road from there, never from another file of the
same number. An exam's folder is a source of exports, too (`vpsci_ros.extras.formats.exporters.open_exam`).
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from vpsci_ros.bags.episodes import bag_episodes, read_bag_episodes
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.data.dataset_description import DESCRIPTION
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.data.near_misses import KINDS, read_near_misses
from vpsci_ros.data.recorded import recorded_episodes, recorded_list
from vpsci_ros.documents import listed
from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import near_misses_part
from vpsci_ros.view.view_page import LIMIT, Source, shown
from vpsci_ros.world.observation import STEP

EXPECTED = "expected a near-miss table (Parquet), the folder of a dataset, a bag or the folder of an exam"
_OF_A_BAG = (".mcap", ".db3", ".zstd")


@dataclass(frozen=True)
class EpisodeSource:
    """A source of episodes on disk: a near-miss table, a dataset, a bag or an exam.

    :ivar path: file or folder.
    :ivar kind: "recorded", "generated", "bag" or "exam".
    :ivar period: time from one frame to the next [s].
    :ivar listed: all episodes without their motion, in order.
    :ivar reader: yields the episodes of these names.
    """

    path: Path
    kind: str
    period: float
    listed: Sequence[Listed]
    reader: Callable[[Collection[str]], Iterator[Episode]]

    @property
    def key(self) -> str:
        """The source's name: that of the file without its ending, or of the folder."""
        return self.path.resolve().name if self.kind == "generated" else self.path.resolve().stem

    def chosen(self, wanted: Sequence[str] = (), limit: int | None = None) -> list[Listed]:
        """Return the episodes that `wanted` names by name, label or number; if it is empty, all or `limit` of them.

        :param limit: greatest number, evenly spread, if `wanted` is empty.
        :raises InvalidInput: one that is not there.
        """
        if not wanted:
            rows = range(len(self.listed)) if limit is None else spread(len(self.listed), limit)
            return [self.listed[row] for row in rows]
        found, left = [], set(wanted)
        for one in self.listed:
            if meant := {one.name, one.label, str(one.number)} & set(wanted):
                found.append(one)
                left -= meant
        if left:
            some = listed(one.name for one in self.listed)
            raise InvalidInput(f"{self.path}: no episode {', '.join(sorted(left))}; it has {some}")
        return found

    def read(self, wanted: Sequence[str] = (), limit: int | None = None) -> Iterator[Episode]:
        """Yield the chosen episodes, see `chosen`."""
        return self.reader({one.name for one in self.chosen(wanted, limit)})


def read_episodes(path: str | Path, wanted: Sequence[str] = (), *, limit: int | None = None) -> Iterator[Episode]:
    """Yield the episodes of a near-miss table, of a dataset (kept ones) or of a bag (ended ones).

    :param wanted: only these, by name ("6:12", "17"), label or number; none: all.
    :param limit: most episodes, evenly spread.
    :raises InvalidInput: another kind of file, a damaged one, or an unknown episode.
    """
    return open_source(path).read(wanted, limit)


def read_source(path: Path, limit: int = LIMIT, wanted: Sequence[str] = ()) -> Source:
    """Return the episodes of a near-miss table, a dataset or a bag for the page.

    :param limit: most episodes, evenly spread.
    :param wanted: only these episodes.
    :raises InvalidInput: also without an episode.
    """
    found = open_source(path)
    episodes = [shown(episode) for episode in found.read(wanted, limit)]
    if not episodes:
        raise InvalidInput(f"{path}: holds no episode, so there is nothing to show")
    return Source(found.key, f"{found.key} ({found.kind})", found.period, episodes, len(found.listed))


def open_source(path: str | Path) -> EpisodeSource:
    """Return the source of episodes at `path`, or the near-miss table of this name ("right_turns/train").

    :raises InvalidInput: another kind of file, or a damaged one.
    """
    path, part = near_misses_part(path)
    if not path.exists():
        raise InvalidInput(f"{path}: no such file or folder; {EXPECTED}")
    if (path / DESCRIPTION).is_file():
        dataset = Dataset(path)
        return EpisodeSource(path, "generated", dataset.period, dataset.listed(), dataset.read)
    if path.suffix in _OF_A_BAG[:2] or (path.is_dir() and any(map(_of_a_bag, path.iterdir()))):
        return _bag(path)
    if path.is_dir():
        raise InvalidInput(f"{path}: neither {DESCRIPTION} nor a bag in it; {EXPECTED}")
    path = path / part
    table = read_near_misses(path, KINDS)
    return EpisodeSource(
        path, "recorded", STEP, recorded_list(table), partial(recorded_episodes, table, source=str(path))
    )


def _of_a_bag(file: Path) -> bool:
    return file.suffix in _OF_A_BAG or file.name == "metadata.yaml"


def _bag(path: Path) -> EpisodeSource:
    bag = Bag(path)
    found = bag_episodes(bag)
    if not found:
        raise InvalidInput(f"{path}: not one episode ended while it was recorded, so it holds none that is whole")

    def read(wanted: Collection[str]) -> Iterator[Episode]:
        chosen = [one for one in found if one.listed.name in wanted]
        return read_bag_episodes(bag, None if len(chosen) == len(found) else chosen)

    period = next(read_bag(bag)).period
    listed = [one.listed for one in found]
    return EpisodeSource(path, "bag", period, listed, read)


def spread(total: int, limit: int) -> list[int]:
    """Return the indices of at most `limit` of `total` episodes, evenly spread."""
    rows: list[int] = np.unique(np.linspace(0, total - 1, min(total, limit)).round().astype(int)).tolist()
    return rows if total else []
