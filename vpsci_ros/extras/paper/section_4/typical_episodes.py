"""The episodes of a picture: one of each scenario, with a typical least CurvTTC and a typical yielding agent."""

import itertools
from collections.abc import Sequence

import numpy as np

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import Episode, yields
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import Yielded

MOST = 512  # episodes of a scenario among which the typical one is looked for
YIELD_NAMES = {
    Yielded.VEHICLE: "Vehicle-yield",
    Yielded.PEDESTRIAN: "Pedestrian-yield",
    Yielded.BOTH: "Both yield",
    Yielded.NONE: "Nobody yields",
}
_NUMBERS = "①②③④⑤⑥⑦⑧"


def typical_episodes(data: Dataset) -> list[tuple[str, Episode]]:
    """Return title and episode for each scenario of a dataset that has a kept episode.

    Of a scenario's first `MOST` kept episodes, those with the most frequent kind of yielding are taken (nobody yields:
    only if nobody ever does), and of these the one whose least CurvTTC lies nearest to their median.

    :raises InvalidInput: not a single episode was kept.
    """
    kept = (list(itertools.islice(data.read(scenario=name), MOST)) for name in data.scenarios)
    found = [_typical(episodes) for episodes in kept if episodes]
    if not found:
        raise InvalidInput(f"{data.folder}: no episode was kept, so there is nothing to draw; simulate more episodes")
    return found


def _typical(episodes: Sequence[Episode]) -> tuple[str, Episode]:
    codes = yields(episodes)
    counts = np.bincount(codes, minlength=4)
    counts[Yielded.NONE] = min(counts[Yielded.NONE], 0 if counts[1:].any() else 1)
    candidates = np.flatnonzero(codes == counts.argmax())
    least = np.array([episodes[i].least_curvttc for i in candidates.tolist()])
    i = int(candidates[np.abs(least - np.median(least)).argmin()])
    one, number = episodes[i], episodes[i].key[0]
    sign = _NUMBERS[number - 1] if 1 <= number <= len(_NUMBERS) else f"({number})"
    how = f"{YIELD_NAMES[Yielded(codes[i])]}, episode {one.number}, least CurvTTC {one.least_curvttc:.2f} s"
    return f"{sign} {one.group}\n{how}", one
