#!/usr/bin/env python
"""Histograms of generated encounters beside recorded ones, watched equally long: a picture for docs/realism.md.

    tools/histograms.py DATASET docs/histograms.png [--data right_turns/dev] [--episodes 2000]

DATASET was generated with dataset.keep_rejected=true. Recorded ones are near misses of whole tracks, without cars that
stand at the onset, tracks that begin critical and paths that stay apart (`vpsci realism --clean`).
"""

import argparse

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.near_misses import clean, read_near_misses
from vpsci_ros.extras.paper.realism.free import as_near_misses
from vpsci_ros.extras.paper.realism.long_run import watched_tracks

HALF_SECOND, THREE_SECONDS = 5, 30  # steps
PANELS = {  # title: bins
    "car: strongest acceleration over 0.5 s [m/s²]": np.linspace(-0.5, 3.0, 36),
    "car: strongest deceleration over 0.5 s [m/s²]": np.linspace(0.0, 4.0, 33),
    "pedestrian: strongest acceleration over 0.5 s [m/s²]": np.linspace(0.0, 2.5, 26),
    "car: speed at the onset [m/s]": np.linspace(0.0, 7.0, 29),
    "car: speed 3 s later, of that at the onset": np.linspace(0.0, 2.5, 26),
    "pedestrian: speed at the onset [m/s]": np.linspace(0.0, 3.0, 25),
    "least CurvTTC [s]": np.linspace(0.0, 5.0, 26),
    "least clearance [m]": np.linspace(-1.0, 6.0, 29),
}


def measured(track: NDArray[np.float64]) -> list[float]:
    """Return the values of `PANELS` of one encounter, float64[T, 4] as `watched_tracks` has it; NaN: too short."""
    drive, walk, ttc, apart = track.T
    gains = [(speed[HALF_SECOND:] - speed[:-HALF_SECOND]) / 0.5 for speed in (drive, walk)]
    later = drive[THREE_SECONDS] / drive[0] if len(drive) > THREE_SECONDS and drive[0] > 0.0 else np.nan
    strongest = [gains[0].max(), -gains[0].min(), gains[1].max()] if len(gains[0]) else [np.nan] * 3
    return [*strongest, drive[0], later, walk[0], ttc.min(), apart.min()]


def main() -> None:
    """Draw the panels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset")
    parser.add_argument("picture")
    parser.add_argument("--data", default="right_turns/dev")
    parser.add_argument("--episodes", type=int, default=2000)
    arguments = parser.parse_args()
    recorded = clean(read_near_misses(arguments.data))
    made = as_near_misses(Dataset(arguments.dataset), arguments.episodes, 0)
    sides = dict(zip(("recorded", "generated"), watched_tracks(recorded, made, 0), strict=True))
    figure = Figure(figsize=(14.0, 6.0), layout="constrained")
    values = {name: np.array([measured(track) for track in tracks.values()]).T for name, tracks in sides.items()}
    for panel, (axes, (title, bins)) in enumerate(zip(figure.subplots(2, 4).flat, PANELS.items(), strict=True)):
        axes.set_title(title, fontsize=9)
        for name, rows in values.items():
            known = rows[panel][np.isfinite(rows[panel])]
            axes.hist(known.clip(bins[0], bins[-1]), bins, density=True, histtype="step", lw=1.8,
                      label=f"{name}, n = {len(known):,}")  # fmt: skip
        axes.legend(fontsize=7)
    figure.savefig(arguments.picture, dpi=90)


if __name__ == "__main__":
    main()
