"""Episodes made small: whole numbers of 16 bits in base64, and a row of JSON for each.

A frame takes 22 bytes, 29 in base64: a thousand episodes of 10 s at 0.05 s come to 6 MB. Positions count from the
middle of their episode. Pedestrians beside the one that matters take eight bytes each and frame more.
"""

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.view.episodes import FIELDS, Source
from vpsci_ros.view.grounds import ground, shipped

UNKNOWN, INFINITE, LARGEST = -32768, 32767, 32766
FINEST = {"x": 5e-3, "y": 5e-3, "heading": 5e-4, "speed": 1e-3, "curvature": 2e-5, "ped_x": 5e-3, "ped_y": 5e-3,
          "ped_vx": 1e-3, "ped_vy": 1e-3, "curvttc": 1e-3, "held": 1.0}  # fmt: skip
"""Steps by which numbers are kept, in their units; coarser ones where a source's numbers are larger than 32766."""
OTHER_STEPS = [FINEST[name] for name in ("ped_x", "ped_y", "ped_vx", "ped_vy")]


def packed(source: Source) -> dict[str, Any]:
    """Return a source as JSON values; its key `frames` is base64 of int16[frames, 11], little-endian.

    Where an episode has further pedestrians, `others` says how many, and the source's `others` is base64 of their
    int16[n * frames, 4] one after the other, in steps of `other_steps`.
    The grounds of scenarios of one's own are in it: two sources may have different ones of the same number.
    """
    groups = sorted({episode.group for episode in source.episodes})
    marks = sorted({mark for episode in source.episodes for mark in episode.marks})
    rows, parts, others = [], [], []
    for episode in source.episodes:
        values = episode.values.copy()
        middle = _middle(values)
        values[:, (0, 1)] -= middle
        values[:, (5, 6)] -= middle
        values[:, 2] -= 2.0 * np.pi * np.round(values[0, 2] / (2.0 * np.pi))
        parts.append(values)
        others.append((episode.others - [*middle, 0.0, 0.0]).reshape(-1, 4))
        critical = np.flatnonzero(episode.curvttc < CRITICAL_TTC)
        rows.append(
            {
                "name": episode.name,
                "group": groups.index(episode.group),
                "scenario": episode.scenario,
                "outcome": episode.outcome,
                "yielded": episode.yielded,
                "least": round(episode.least, 3) if np.isfinite(episode.least) else None,
                "onset": int(critical[0]) if len(critical) else None,
                "frames": len(values),
                "middle": middle.round(3).tolist(),
                "size": [float(value) for value in episode.size],
                "marks": [marks.index(mark) for mark in episode.marks],
            }
            | ({"others": len(episode.others)} if len(episode.others) else {})
        )
    frames = np.concatenate(parts)
    steps = _steps(frames)
    return {
        "key": source.key,
        "title": source.title,
        "period": source.period,
        "total": source.total,
        "groups": groups,
        "marks": marks,
        "episodes": rows,
        "fields": FIELDS,
        "steps": steps.tolist(),
        "grounds": {scenario.number: ground(scenario) for scenario in source.scenarios},
        "frames": base64.b64encode(_quantised(frames, steps).tobytes()).decode(),
    } | _packed_others(np.concatenate(others))


def _packed_others(motion: np.ndarray) -> dict[str, Any]:
    """Return the further pedestrians, float64[n, 4], as JSON values; without any, nothing."""
    if not len(motion):
        return {}
    steps = np.maximum(OTHER_STEPS, np.abs(motion).max(axis=0) / LARGEST)
    return {
        "other_steps": steps.tolist(),
        "others": base64.b64encode(_quantised(motion, steps).tobytes()).decode(),
    }


def grounds(sources: Sequence[Source]) -> dict[int, Any]:
    """Return the ground of every scenario of Table 6 that occurs, by its number."""
    numbers = {episode.scenario for source in sources for episode in source.episodes}
    return {number: ground(scenario) for number, scenario in shipped().items() if number in numbers}


def _middle(values: np.ndarray) -> np.ndarray:
    places = np.concatenate([values[:, 0:2], values[:, 5:7]])
    middle: np.ndarray = ((np.nanmin(places, axis=0) + np.nanmax(places, axis=0)) / 2.0).round(3)
    return middle


def _steps(frames: np.ndarray) -> np.ndarray:
    """Return the step of each column: the finest one with which its largest number fits."""
    finite = np.where(np.isfinite(frames), np.abs(frames), 0.0)
    steps: np.ndarray = np.maximum([FINEST[name] for name in FIELDS], finite.max(axis=0) / LARGEST)
    return steps


def _quantised(frames: np.ndarray, steps: np.ndarray) -> np.ndarray:
    codes = np.zeros(frames.shape, "<i2")
    finite = np.isfinite(frames)
    codes[finite] = np.round((frames / steps)[finite])
    codes[np.isposinf(frames)] = INFINITE
    codes[np.isnan(frames) | np.isneginf(frames)] = UNKNOWN
    return codes
