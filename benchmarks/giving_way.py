"""Who goes first at each place, and how much cars brake in the 3 s after the onset: by place and speed.

    vpsci import vci_dut vci_citr --format vci-dut --format vci-citr -o campus.parquet
    python benchmarks/giving_way.py right_turns campus.parquet

An onset is the first step of a near miss with CurvTTC below 5 s, with 3 s recorded after it. The pedestrian goes first
where its path crosses the car's (carried on straight for 15 m) before the car is there; the car, where its rear has
passed the crossing point, or the pedestrian where the paths do not cross; otherwise it is open. Accelerations are those
of which banks are made. 95% intervals by clips, or by groups where there are fewer than four. Twelve CPU seconds.
"""

import argparse

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.interactions import from_rows
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.evaluation.statistics import cluster_counts, interval, units_of
from vpsci_ros.policy.make_bank import LEAST, actions_of, fitted
from vpsci_ros.safety import VEHICLE_LENGTH
from vpsci_ros.safety.encroachment import first_crossing

AHEAD, SECOND = 15.0, 10  # [m], [steps]
SPEEDS = ((0.0, 2.0), (2.0, 4.0), (4.0, np.inf))  # [m/s] at the onset

Floats = NDArray[np.float64]


def first_to_go(motion: Floats) -> str:
    """Return who goes first in a track from its onset on, float64[T, 9]: car, pedestrian or open."""
    x, y, px, py = (np.ascontiguousarray(motion[:, k]) for k in (0, 1, 5, 6))
    driven, walked, cross_x, cross_y = first_crossing(x, y, AHEAD, motion[-1, 2], px, py)
    if walked < driven:
        return "pedestrian"
    to_x, to_y = (px, py) if np.isnan(walked) else (cross_x, cross_y)
    past = (x - to_x) * np.cos(motion[:, 2]) + (y - to_y) * np.sin(motion[:, 2])
    return "car" if (past > 0.5 * VEHICLE_LENGTH).any() else "open"


def with_interval(values: Floats, units: NDArray[np.str_]) -> str:
    """Return the mean of float64[n] with its interval by units."""
    counts = cluster_counts(units, 0)
    low, high = interval((counts @ values) / np.maximum(counts.sum(axis=1), 1.0))
    return f"{values.mean():.2f} [{low:.2f}, {high:.2f}]"


def print_place(name: str) -> None:
    """Print the rows of one near-miss table."""
    recorded = from_rows(read_near_misses(name))
    recorded = recorded.take(np.flatnonzero(recorded.first <= recorded.length - 1 - LEAST))
    units, begin = units_of(recorded.clip, recorded.group), recorded.first
    print(f"{name}: intervals by {units.text}")
    tracks = [motion[:end] for motion, end in zip(recorded.motion, recorded.length, strict=True)]
    first = np.array([first_to_go(track[at:]) for track, at in zip(tracks, begin, strict=True)])
    fits = [fitted(track) for track in tracks]
    fast = np.array([np.hypot(*fit[at, 3:5]) for fit, at in zip(fits, begin, strict=True)])
    done = np.stack([actions_of(fit)[at : at + LEAST, 0] for fit, at in zip(fits, begin, strict=True)])
    braking = done.reshape(len(done), -1, SECOND).mean(axis=2)
    for low, high in SPEEDS:
        inside = (fast >= low) & (fast < high)
        held = with_interval((first == "pedestrian")[inside].astype(np.float64), units.labels[inside])
        print(f"{name}, {low:g} to {high:g} m/s: n = {inside.sum()}, pedestrian first {held}")
        for who in ("car", "pedestrian", "open"):
            own = inside & (first == who)
            if own.any():
                seconds = "; ".join(with_interval(column, units.labels[own]) for column in braking[own].T)
                print(f"  {who} first, n = {own.sum()}: {seconds} m/s2 in seconds 1, 2, 3", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="+", help="right_turns, Parquet files, or parts of either")
    for name in parser.parse_args().tables:
        print_place(name)


if __name__ == "__main__":
    main()
