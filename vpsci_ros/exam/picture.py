"""The picture with which an exam's report begins: rates of failures, and distances in the worst encounters.

The page's template draws it as SVG; here is what lies where, in units of its view boxes.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vpsci_ros.data.episode import Episode
from vpsci_ros.exam.criteria import limits
from vpsci_ros.exam.exam import ADS, title_of

WIDTH, LEFT, RIGHT = 480.0, 150.0, 410.0  # of both drawings, and of the axis of rates between names and numbers
ROW = 38.0  # height of a pedestrian
HEIGHT, BOTTOM = 220.0, 190.0  # of the drawing of distances, and where its axis of time lies
COLOURS = ("#d55e00", "#0072b2", "#009e73")  # Okabe and Ito's, which most people can distinguish
FARTHEST = 20.0  # [m] that is drawn
_SCALES = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # largest share of an axis
_SECONDS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # between the marks of an axis


def rates(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the drawing of the failures with each pedestrian: rows of dots with intervals, limits of criteria, marks.

    :param report: as report.json has it.
    """
    measure, drivers = f"{report['failure']}_rate", report["drivers"]
    found = {driver: {name: row[measure] for name, row in rows.items() if row[measure]["value"] is not None}
             for driver, rows in drivers.items()}  # fmt: skip
    limit = limits(report["criteria"], measure)
    most = max([*(row["high"] for rows in found.values() for row in rows.values()), *limit.values()], default=0.0)
    scale = next((scale for scale in _SCALES if scale >= most), 1.0)

    def at(share: float) -> float:
        return round(LEFT + (RIGHT - LEFT) * min(share / scale, 1.0), 1)

    rows = []
    for place, name in enumerate(drivers[ADS]):
        middle = ROW * (place + 0.5)
        dots = [
            {"driver": driver, "y": middle + (-7.0 if driver == ADS else 8.0), "text": f"{100.0 * row['value']:.1f}%",
             **{key: at(row[key]) for key in ("value", "low", "high")}}
            for driver, of in found.items() if (row := of.get(name))
        ]  # fmt: skip
        limited = at(limit[name]) if name in limit else None
        rows.append({"title": title_of(name), "y": middle, "dots": dots, "limit": limited})
    marks = [(at(share), f"{100.0 * share:g}%") for share in (0.0, 0.5 * scale, scale)]
    return {"title": report["definitions"][measure]["title"], "rows": rows, "marks": marks, "height": ROW * len(rows)}


def distances(chosen: Sequence[Mapping[str, Any]], episodes: Mapping[str, Sequence[Episode]]) -> dict[str, Any]:
    """Return the drawing of the distance to the nearest pedestrian over time, a line for each chosen episode.

    :param chosen: rows of the table of episodes; `episodes`: pedestrian -> episodes of the ADS, frame by frame.
    """
    drives = [next(each for each in episodes[row["pedestrian"]] if each.key == (row["scenario"], row["episode"]))
              for row in chosen]  # fmt: skip
    longest = max((float(episode.time[-1]) for episode in drives), default=0.0) or 1.0
    step = next((step for step in _SECONDS if longest <= 6.0 * step), _SECONDS[-1])
    left = 40.0

    def at(time: float) -> float:
        return round(left + (WIDTH - left - 10.0) * time / longest, 1)

    lines = []
    for episode, colour in zip(drives, COLOURS, strict=False):
        near = np.fmin(np.fmin.reduce(episode.filled().distance, axis=0), FARTHEST)
        places = [(at(float(t)), BOTTOM * (1.0 - float(d) / FARTHEST)) for t, d in zip(episode.time, near, strict=True)]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        lines.append({"points": points, "end": places[-1], "touched": episode.outcome == "collision", "colour": colour})
    across = [(at(time), f"{time:g} s") for time in np.arange(0.0, longest + 1e-6, step).tolist()]
    up = [(BOTTOM * (1.0 - d / FARTHEST), f"{d:g} m") for d in (0.0, 0.5 * FARTHEST, FARTHEST)]
    return {"lines": lines, "across": across, "up": up, "left": left}
