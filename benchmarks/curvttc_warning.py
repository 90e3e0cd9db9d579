"""How well a measure warns: the AUC of CurvTTC, 2D TTC and the distance of the centres on recorded near misses.

    python benchmarks/curvttc_warning.py right_turns

Steps are 1 s apart, from 0.5 s after the beginning of a track to 3 s before its end, where the footprints are at least
0.5 m apart. The event of a step is a clearance below 0.5 m within the next 3 s. AUC: the share of pairs of a step with
and a step without an event in which the measure is smaller at the first; equal values count half. Measures know nothing
of later steps. 95% intervals by clips, or by groups where there are fewer than four. Five CPU seconds.
"""

import argparse

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.data.recorded import size_of
from vpsci_ros.evaluation.statistics import cluster_counts, interval, units_of
from vpsci_ros.safety import clearance, ttc_2d

FIRST, EVERY, WITHIN, NEAR = 5, 10, 30, 0.5  # [steps] three times, [m]
MEASURES = ("CurvTTC", "2D TTC", "distance")

Floats = NDArray[np.float64]


def steps_of(part: pl.DataFrame) -> Floats:
    """Return a row for each step of one near miss, float64[n, 4]: event, `MEASURES`."""
    columns = ("veh_x", "veh_y", "veh_heading", "veh_speed", "ped_x", "ped_y", "ped_vx", "ped_vy")
    x, y, heading, speed, px, py, vx, vy = (part[name].to_numpy() for name in columns)
    length, width = size_of(part)
    apart = clearance(x, y, heading, px, py, length=length, width=width)
    at = np.arange(FIRST, len(x) - WITHIN, EVERY)
    at = at[apart[at] >= NEAR]
    straight = ttc_2d(x, y, heading, speed, px, py, vx, vy, length=length, width=width)
    event = np.array([apart[k + 1 : k + 1 + WITHIN].min() < NEAR for k in at], np.float64)
    measures = part["curvttc_causal"].to_numpy(), straight, np.hypot(px - x, py - y)
    return np.stack([event, *(values[at] for values in measures)], axis=1)


def auc(event: NDArray[np.bool_], values: Floats, weights: Floats) -> Floats:
    """Return the AUC in each resample, float64[count]; `weights` float64[count, n] of the steps."""
    _, place = np.unique(values, return_inverse=True)
    ones, zeros = (np.zeros((len(weights), place.max() + 1)) for _ in range(2))
    for at, side in ((np.flatnonzero(event), ones), (np.flatnonzero(~event), zeros)):
        for k in at:
            side[:, place[k]] += weights[:, k]
    above = zeros.sum(axis=1, keepdims=True) - np.cumsum(zeros, axis=1)  # larger values without an event
    pairs = ones.sum(axis=1) * zeros.sum(axis=1)
    area: Floats = (ones * (above + 0.5 * zeros)).sum(axis=1) / np.where(pairs > 0.0, pairs, np.nan)
    return area


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", help="right_turns, a Parquet file, or a part of either")
    parts = read_near_misses(parser.parse_args().table).partition_by("interaction", maintain_order=True)
    rows = [steps_of(part) for part in parts]
    counts = [len(own) for own in rows]
    clips = np.repeat([f"{part['source'][0]}/{part['clip'][0]}" for part in parts], counts)
    units = units_of(clips, np.repeat([part["group"][0] for part in parts], counts))
    table = np.concatenate(rows)
    draws = cluster_counts(units.labels, 0, 500)
    event, distance = table[:, 0] > 0.0, table[:, 3]
    inside = {
        "all": np.ones(len(table), bool),
        "centres < 5 m apart": distance < 5.0,
        "5 to 10 m": (distance >= 5.0) & (distance < 10.0),
    }
    print(f"intervals by {units.text}")
    for name, here in inside.items():
        print(f"{name}: {here.sum()} steps, {event[here].sum()} events")
        of = {}
        for measure, values in zip(MEASURES, table[here, 1:].T, strict=True):
            once = auc(event[here], values, np.ones((1, here.sum())))[0]
            of[measure] = once, auc(event[here], values, draws[:, here])
            print("  {}: AUC {:.3f} [{:.3f}, {:.3f}]".format(measure, once, *interval(of[measure][1])))
        for measure in MEASURES[1:]:
            gap, gaps = (a - b for a, b in zip(of[MEASURES[0]], of[measure], strict=True))
            print("  CurvTTC less {}: {:+.3f} [{:+.3f}, {:+.3f}]".format(measure, gap, *interval(gaps)), flush=True)


if __name__ == "__main__":
    main()
