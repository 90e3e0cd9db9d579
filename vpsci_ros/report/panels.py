"""Which episodes a picture shows: one of each scenario, typical in how near it came and in who gave way."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.dataset_reader import Dataset, EpisodeArrays
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.yields import YIELD_NAMES, headings, yields
from vpsci_ros.safety.yielding import Yielded

Floats = NDArray[np.float64]
_NUMBERS = "①②③④⑤⑥⑦⑧"


@dataclass(frozen=True)
class Panel:
    """One interaction to be drawn.

    :ivar title: scenario, number, who yielded.
    :ivar scenario: its number, by which lane and crosswalk are found.
    :ivar vehicle, pedestrian: float64[T, 2], positions [m].
    :ivar vehicle_speed, pedestrian_speed: float64[T] [m/s].
    :ivar heading: float64[T] of the vehicle [rad].
    :ivar nearest: step of the least CurvTTC.
    :ivar others: positions and speeds of further pedestrians, likewise.
    """

    title: str
    scenario: int
    vehicle: Floats
    vehicle_speed: Floats
    heading: Floats
    pedestrian: Floats
    pedestrian_speed: Floats
    nearest: int
    others: Sequence[tuple[Floats, Floats]] = ()


def typical_panels(folder: str | Path) -> list[Panel]:
    """Return a panel for each scenario of a dataset that has a kept episode.

    Taken is, among the episodes with the scenario's most frequent kind of yielding (none at all only where there is
    nothing else), the one whose least CurvTTC lies nearest to their median; looked for in the first row group.

    :raises InvalidInput: the folder is no dataset, or not a single episode was kept.
    """
    data = Dataset(folder)
    panels = []
    for name, counts in data.scenarios.items():
        part = next(iter(data.episodes(name)), None)
        if part is not None:
            codes = yields(part, data.period)
            panels.append(panel(part, _typical(part, codes), codes, name, counts["number"]))
    if not panels:
        raise InvalidInput(f"{folder}: no episode was kept, so there is nothing to draw; simulate more episodes")
    return panels


def _typical(part: EpisodeArrays, codes: NDArray[np.uint8]) -> int:
    counts = np.bincount(codes, minlength=4)
    counts[Yielded.NONE] = min(counts[Yielded.NONE], 0 if counts[1:].any() else 1)
    candidates = np.flatnonzero(codes == counts.argmax())
    least = np.nanmin(part["CurvTTC"][candidates], axis=1)
    return int(candidates[np.abs(least - np.median(least)).argmin()])


def panel(part: EpisodeArrays, i: int, codes: NDArray[np.uint8], name: str, number: int) -> Panel:
    """Return episode `i` of `part` as a panel; `codes` uint8[n] says who yielded."""
    seen = ~np.isnan(part.values[i, : part.lengths[i], :8]).any(axis=1)
    column = {key: part[key][i, : part.lengths[i]][seen].astype(np.float64) for key in _KEYS}
    least = np.nanmin(column["CurvTTC"])
    sign = _NUMBERS[number - 1] if 1 <= number <= len(_NUMBERS) else f"({number})"
    return Panel(
        title=f"{sign} {name}\n{YIELD_NAMES[Yielded(codes[i])]}, episode {part.count[i]}, least CurvTTC {least:.2f} s",
        scenario=number,
        vehicle=np.column_stack([column["position_x_av"], column["position_y_av"]]),
        vehicle_speed=np.hypot(column["velocity_x_av"], column["velocity_y_av"]),
        heading=headings(column["velocity_x_av"][None], column["velocity_y_av"][None])[0],
        pedestrian=np.column_stack([column["position_x_ped"], column["position_y_ped"]]),
        pedestrian_speed=np.hypot(column["velocity_x_ped"], column["velocity_y_ped"]),
        nearest=int(np.nanargmin(column["CurvTTC"])),
    )


_KEYS = (
    *("position_x_av", "position_y_av", "velocity_x_av", "velocity_y_av"),
    *("position_x_ped", "position_y_ped", "velocity_x_ped", "velocity_y_ped", "CurvTTC"),
)
