"""Who goes first at each place, and how much cars brake in the 3 s after the onset: by place and speed.

    vpsci import vci_dut vci_citr --format vci-dut --format vci-citr -o campus.parquet
    python benchmarks/giving_way.py right_turns campus.parquet

An onset is the first step of a near miss with CurvTTC below 5 s, with 3 s recorded after it. Who goes first is decided
by `safety.who_goes_first`. Accelerations are those of which banks are made. 95% intervals by clips, or by groups where
there are fewer than four. Twelve CPU seconds.
"""

import argparse

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.interactions import from_rows
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.evaluation.statistics import cluster_counts, interval, units_of
from vpsci_ros.policy.make_bank import LEAST, actions_of, fitted
from vpsci_ros.safety import who_goes_first

SECOND = 10  # [steps]
SPEEDS = ((0.0, 2.0), (2.0, 4.0), (4.0, np.inf))  # [m/s] at the onset

Floats = NDArray[np.float64]


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
    first = np.array([who_goes_first(*track[at:, [0, 1, 2, 5, 6]].T) for track, at in zip(tracks, begin, strict=True)])
    fits = [fitted(track) for track in tracks]
    fast = np.array([np.hypot(*fit[at, 3:5]) for fit, at in zip(fits, begin, strict=True)])
    done = np.stack([actions_of(fit)[at : at + LEAST, 0] for fit, at in zip(fits, begin, strict=True)])
    braking = done.reshape(len(done), -1, SECOND).mean(axis=2)
    for low, high in SPEEDS:
        inside = (fast >= low) & (fast < high)
        held = with_interval((first == 1.0)[inside].astype(np.float64), units.labels[inside])
        print(f"{name}, {low:g} to {high:g} m/s: n = {inside.sum()}, pedestrian first {held}")
        for who, went in (("car", first == 0.0), ("pedestrian", first == 1.0), ("open", np.isnan(first))):
            own = inside & went
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
