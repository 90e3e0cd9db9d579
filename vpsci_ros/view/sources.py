"""What a path holds, a near-miss table, a dataset or a bag, as a source of the page."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from vpsci_ros.data.dataset_index import DESCRIPTION
from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import near_misses_path
from vpsci_ros.view.bag import bag_source
from vpsci_ros.view.episodes import Source
from vpsci_ros.view.generated import dataset_source
from vpsci_ros.view.recorded import near_miss_source

LIMIT = 1000  # episodes of a source on one page, unless more are asked for
EXPECTED = "expected a near-miss table (Parquet), the folder of a dataset, a bag or the folder of an exam"


def read_source(path: Path, limit: int = LIMIT, wanted: Sequence[str] = ()) -> Source:
    """Return what lies at `path`, or the near misses that it names ("right_turns").

    :param limit: episodes at most; where there are more, evenly spread ones are taken.
    :param wanted: only these episodes, by name: "6:12", or the number of an interaction.
    :raises InvalidInput: nothing is there, it is none of these or damaged, it holds no episode, or none as wanted.
    """
    path = near_misses_path(path)
    if not path.exists():
        raise InvalidInput(f"{path}: no such file or folder; {EXPECTED}")
    if path.is_dir() and (path / DESCRIPTION).is_file():
        source = dataset_source(path, limit, wanted)
    elif path.suffix in (".mcap", ".db3") or (path.is_dir() and _holds_bag(path)):
        source = bag_source(path, limit, wanted)
    elif path.is_dir():
        raise InvalidInput(f"{path}: neither dataset.json nor a bag in it; {EXPECTED}")
    else:
        source = near_miss_source(path, limit, wanted)
    if not source.episodes:
        raise InvalidInput(f"{path}: holds no episode, so there is nothing to show")
    return source


def _holds_bag(path: Path) -> bool:
    return any(file.suffix in (".mcap", ".db3", ".zstd") or file.name == "metadata.yaml" for file in path.iterdir())


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
