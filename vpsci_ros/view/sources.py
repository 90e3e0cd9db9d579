"""What the page shows: episodes with who gave way and the marks it filters by, in the sources that they come from."""

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from vpsci_ros.data.episode import YIELDED, Episode
from vpsci_ros.episodes import open_source
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import CONFLICT_TTC, CRITICAL_TTC, Yielded

LIMIT = 1000  # episodes of a source on one page, unless more are requested


class Shown(NamedTuple):
    """An episode on the page: of several pedestrians the most critical one is looked at, the others are beside it.

    :ivar yielded: who gave way, one of `YIELDED`.
    :ivar marks: names that the page filters by, say "hard_braking".
    :ivar failure: what its failure has in common with others, in words; empty where it is none.
    """

    episode: Episode
    yielded: str
    marks: tuple[str, ...]
    failure: str = ""


@dataclass(frozen=True)
class Source:
    """Episodes of one kind.

    :ivar key: by which links find it, unique on its page.
    :ivar title: as people read it.
    :ivar period: time from one frame to the next [s].
    :ivar total: episodes that there are, of which `episodes` may be a part.
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
    """Return an episode with who gave way in it, and the marks that apply."""
    code, least = episode.yielded(), episode.least_curvttc
    applies = {
        "critical": least < CRITICAL_TTC,
        "conflict": least < CONFLICT_TTC,
        "vehicle_yields": code & Yielded.VEHICLE,
        "pedestrian_yields": code & Yielded.PEDESTRIAN,
    }
    return Shown(episode, YIELDED[code], (*(name for name, does in applies.items() if does), *episode.marks))


def read_source(path: Path, limit: int = LIMIT, wanted: Sequence[str] = ()) -> Source:
    """Return the episodes of a near-miss table, a dataset or a bag, see `vpsci_ros.episodes.read_episodes`.

    :param limit: episodes at most; where there are more, evenly spread ones are taken.
    :param wanted: only these episodes.
    :raises InvalidInput: also where there is no episode.
    """
    found = open_source(path)
    episodes = [shown(episode) for episode in found.read(wanted, limit)]
    if not episodes:
        raise InvalidInput(f"{path}: holds no episode, so there is nothing to show")
    return Source(found.key, f"{found.key} ({found.kind})", found.period, episodes, len(found.listed))


def with_unique_keys(sources: Sequence[Source]) -> list[Source]:
    """Return sources whose keys and titles differ; those that come again get a number."""
    seen: Counter[str] = Counter()
    out = []
    for source in sources:
        seen[source.key] += 1
        again = seen[source.key]
        renamed = dataclasses.replace(source, key=f"{source.key}-{again}", title=f"{source.title} {again}")
        out.append(source if again == 1 else renamed)
    return out
