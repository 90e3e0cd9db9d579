#!/usr/bin/env python
"""Where a bank was recorded and where you want to use it: a picture for docs/elsewhere.md.

    tools/ranges.py BANK TABLE... -o docs/elsewhere.png     # such as people right_turns campus.parquet

Each point is a recorded onset of a near-miss table; the box is the range of the bank's first source.
"""

import argparse

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.onsets import find_onsets
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.onset_range import beyond, onsets_in
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.report.canvas import blank_figure, save_png

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")


def main() -> None:
    """Draw the tables' onsets and the box."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bank")
    parser.add_argument("tables", nargs="+")
    parser.add_argument("-o", "--output", required=True)
    arguments = parser.parse_args()
    bank = load_policy(arguments.bank)
    if not isinstance(bank, Bank):
        raise InvalidInput(f"{arguments.bank}: expected a bank of recorded people, got weights of networks")
    reach = bank.of().reach
    axis = blank_figure(6.4, 3.6).subplots()
    for table, colour in zip(arguments.tables, COLOURS, strict=False):
        start = find_onsets(read_near_misses(table)).start
        onsets = onsets_in(start[:, :2], start[:, 3:5], start[:, 5:7], start[:, 7:9])
        share = float(beyond(onsets, reach).mean())
        label = f"{table}: {len(onsets)} onsets, {share:.0%} beyond"
        axis.plot(onsets[:, 0], onsets[:, 1], "o", color=colour, markersize=3, alpha=0.5, label=label)
    (left, right), (low, high) = reach[0, [0, -1]], reach[1, [0, -1]]
    axis.add_patch(
        Rectangle((left, low), right - left, high - low, fill=False, linewidth=1.5, label="range of the bank")
    )
    axis.set_xlabel("speed of the car at the onset [m/s]")
    axis.set_ylabel("distance at the onset [m]")
    axis.set_xlim(left=-0.1)
    axis.set_ylim(0.0, float(np.ceil(axis.get_ylim()[1])))
    axis.legend(fontsize=7, frameon=False)
    figure = axis.get_figure()
    assert isinstance(figure, Figure)
    save_png(figure, arguments.output)


if __name__ == "__main__":
    main()
