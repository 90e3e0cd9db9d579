"""Which factors let the last acceleration fade: energy scores on the recordings that policies learn from.

    python benchmarks/fading.py [right_turns/train] [--car 0.9 0.95 1.0] [--pedestrian 0.7 0.8 0.9]

For each pair of factors of a step of 0.1 s: the energy score over 3 s as a share of constant velocity's, of the control
`fading_acceleration` and of the sampler about it, whose residuals are those of other clips. `choice.FADES` has the
pair with the least score of the control. Half a minute.
"""

import argparse

from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.evaluation.onsets import find_onsets
from vpsci_ros.evaluation.predictors import FadingAcceleration
from vpsci_ros.evaluation.roll_out_scores import energy_score
from vpsci_ros.evaluation.simulators import residual_sampler, rolled_out, tracked


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", nargs="?", default="right_turns/train", help="near misses")
    parser.add_argument("--car", type=float, nargs="+", default=[0.9, 0.95, 1.0])
    parser.add_argument("--pedestrian", type=float, nargs="+", default=[0.7, 0.8, 0.9])
    given = parser.parse_args()
    onsets = find_onsets(read_near_misses(given.data))
    control = energy_score(tracked(onsets), onsets.recorded).mean()
    print(f"{given.data}: {len(onsets)} onsets of {onsets.units.text}; share of constant velocity's energy score")
    for car in given.car:
        for pedestrian in given.pedestrian:
            middle = rolled_out(FadingAcceleration((car, pedestrian)), onsets)
            made = middle, residual_sampler(onsets, onsets, middle, middle)
            alone, sampler = (energy_score(own, onsets.recorded).mean() / control for own in made)
            print(f"  car {car:g}, pedestrian {pedestrian:g}: {alone:.3f}, its sampler {sampler:.3f}", flush=True)


if __name__ == "__main__":
    main()
