"""Collisions against likeness while stage 2 learns: the validation rows of runs' logs, as a table and as one picture.

    python benchmarks/front.py [-o front.png] [NAME=]FOLDER ...

A folder is one that `vpsci refine` or `tools/make_weights.py` (`refine/` in it) wrote. Collisions and both goals are
shares of the critical episodes of the validation world (seed 4242), with Wilson's 95% interval; the error is the
closed-loop ADE on held-out clips [m]. Each run is a line from its first to its last measurement, to the lower left of
which is better. The dashed line is the control of the error: the last velocity repeated, on the same clips.
"""

import argparse
from pathlib import Path

import polars as pl

from vpsci_ros.evaluation.statistics import wilson_interval
from vpsci_ros.learning.online import LOG
from vpsci_ros.learning.refine import WEIGHTS
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.report.canvas import new_figure, save_png

COLLISIONS, GOALS, EPISODES = "validation_collision_rate", "validation_goal_rate", "validation_critical_episodes"
ERROR = "held_out_closed_loop_ade"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", metavar="[NAME=]FOLDER")
    parser.add_argument("-o", "--output", type=Path, default=Path("front.png"))
    given = parser.parse_args()
    figure, ((axis,),) = new_figure(7.0, 5.0)
    for text in given.runs:
        name, equals, folder = text.rpartition("=")
        name = name if equals else Path(folder).name
        log = pl.read_csv(Path(folder) / LOG).drop_nulls(COLLISIONS)
        print(f"{name}\n  critical episodes, updates; collisions; both goals; closed-loop ADE")
        for row in log.iter_rows(named=True):
            n = int(row[EPISODES])
            low, high = wilson_interval(round(row[COLLISIONS] * n), n)
            share = f"{100 * row[COLLISIONS]:.1f}% [{100 * low:.1f}, {100 * high:.1f}] of {n}"
            print(f"  {row['episodes']:5d}, {row['updates']:5d}; {share}; {100 * row[GOALS]:.1f}%; {row[ERROR]:.2f} m")
        (line,) = axis.plot(log[ERROR], 100.0 * log[COLLISIONS], ".-", linewidth=1.0, label=name)
        axis.plot(log[ERROR][-1], 100.0 * log[COLLISIONS][-1], "o", color=line.get_color())
        control = load_weights(Path(folder) / WEIGHTS).facts["held_out"]["control"]["closed_loop_ade"]
        print(f"  the last velocity repeated: {control:.2f} m")
        axis.axvline(control, color=line.get_color(), linestyle="--", linewidth=0.8)
    axis.set(xlabel="closed-loop ADE on held-out clips [m]", ylabel="collisions in the validation world [%]")
    axis.set(xlim=(0.0, None), ylim=(0.0, None))
    axis.legend(title="large point: the last weights")
    save_png(figure, given.output)
    print(f"written: {given.output}")


if __name__ == "__main__":
    main()
