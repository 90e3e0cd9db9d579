"""Sources of the page: episodes with yielding and the properties by which the page filters."""

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from vpsci_ros.data.episode import YIELDED, Episode
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import CONFLICT_TTC, CRITICAL_TTC, Yielded
from vpsci_ros.view.episode_sources import open_source

LIMIT = 1000  # episodes of a source on one page, unless more are requested


class Shown(NamedTuple):
    """An episode on the page, with its most critical pedestrian first.

    :ivar yielded: one of `YIELDED`.
    :ivar marks: filters of the page, such as "hard_braking".
    :ivar failure: group of its failure, in words; empty without a failure.
    """

    episode: Episode
    yielded: str
    marks: tuple[str, ...]
    failure: str = ""


@dataclass(frozen=True)
class Source:
    """Episodes of one kind.

    :ivar key: name in links, unique on its page.
    :ivar title: displayed name.
    :ivar period: time from one frame to the next [s].
    :ivar total: number of all episodes; `episodes` may be a part of them.
    :ivar changes: name of another source's episode -> what was changed in it, each a list of episodes of this source by
        the amount: the page has a slider through them.
    """

    key: str
    title: str
    period: float
    episodes: Sequence[Shown]
    total: int
    changes: Mapping[str, Any] = field(default_factory=dict)


def shown(episode: Episode) -> Shown:
    """Return an episode with its yielding and the properties by which the page filters."""
    code, least = episode.yielded(), episode.least_curvttc
    applies = {
        "critical": least < CRITICAL_TTC,
        "conflict": least < CONFLICT_TTC,
        "vehicle_yields": code & Yielded.VEHICLE,
        "pedestrian_yields": code & Yielded.PEDESTRIAN,
    }
    return Shown(episode, YIELDED[code], (*(name for name, does in applies.items() if does), *episode.marks))


def read_source(path: Path, limit: int = LIMIT, wanted: Sequence[str] = ()) -> Source:
    """Return the episodes of a near-miss table, a dataset or a bag, see `vpsci_ros.view.sources.read_episodes`.

    :param limit: most episodes, evenly spread.
    :param wanted: only these episodes.
    :raises InvalidInput: also without an episode.
    """
    found = open_source(path)
    episodes = [shown(episode) for episode in found.read(wanted, limit)]
    if not episodes:
        raise InvalidInput(f"{path}: holds no episode, so there is nothing to show")
    return Source(found.key, f"{found.key} ({found.kind})", found.period, episodes, len(found.listed))


def with_unique_keys(sources: Sequence[Source]) -> list[Source]:
    """Return sources with unique keys and titles; repeated ones get a number."""
    seen: Counter[str] = Counter()
    out = []
    for source in sources:
        seen[source.key] += 1
        again = seen[source.key]
        renamed = dataclasses.replace(source, key=f"{source.key}-{again}", title=f"{source.title} {again}")
        out.append(source if again == 1 else renamed)
    return out
