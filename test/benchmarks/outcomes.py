"""How critical episodes end under policies, and who slows down: the figures of the model card.

    python test/benchmarks/outcomes.py [--episodes 250] [--seed 20261121] [--weights refined pretrained]
                                       [--near-misses near_misses.parquet]

Without exploration; the unit is the episode that becomes critical; 95% Wilson intervals. Controls: the unrefined
weights, and no acceleration at all. With near misses, also who slows down in these, between the first critical step and
the last of those that stay critical for a second. Half a minute.
"""

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np

from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.learning.interactions import Interactions, from_table
from vpsci_ros.learning.measured import measure_outcomes, rates_with_intervals
from vpsci_ros.learning.protocols import eligible
from vpsci_ros.learning.rollout import policies, rollout
from vpsci_ros.learning.weights import Weights, load_weights
from vpsci_ros.resources import weights_path
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.monitor import MonitorConfig
from vpsci_ros.world.state import RUNNING

SLOWER = 0.8  # of the speed at the hand-over


def slowing(weights: Weights, episodes: list[tuple[int, int]], seed: int) -> tuple[float, float, int]:
    """Return the shares of handed-over episodes in which vehicle and pedestrian slow by a fifth, and their number."""
    world = World(WorldConfig(), load_scenarios(range(1, 9)), episodes, 512, seed)
    speeds = defaultdict(list)
    for tick in rollout(world, MonitorConfig(), policies(weights, world, seed, explore=False)):
        for row in tick.state[(tick.state["status"] == RUNNING) & (tick.state["controlled"] == 1)]:
            pair = row["vehicle_speed"], np.hypot(row["pedestrian_vx"], row["pedestrian_vy"])
            speeds[int(row["scenario"]), int(row["episode"])].append(pair)
    slower = [np.min(pairs, axis=0) < SLOWER * np.array(pairs[0]) for pairs in speeds.values()]
    vehicle, pedestrian = np.mean(slower, axis=0)
    return float(vehicle), float(pedestrian), len(slower)


def recorded_slowing(interactions: Interactions) -> tuple[float, float, int]:
    """Return the same of recorded near misses, from the first critical step to the last."""
    motion, step = interactions.motion, np.arange(interactions.motion.shape[1])
    inside = (step >= interactions.first[:, None]) & (step <= interactions.last[:, None])
    shares = []
    for columns in ((3, 4), (7, 8)):
        speed = np.hypot(motion[..., columns[0]], motion[..., columns[1]])
        least = np.where(inside, speed, np.inf).min(axis=1)
        shares.append(float((least < SLOWER * speed[np.arange(len(speed)), interactions.first]).mean()))
    return shares[0], shares[1], len(motion)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=250, help="in each scenario")
    parser.add_argument("--seed", type=int, default=20261121, help="of the world; another one than training had")
    parser.add_argument("--weights", nargs="+", default=["refined", "pretrained"], help="files or shipped names")
    parser.add_argument("--near-misses", type=Path, help="near-miss table")
    arguments = parser.parse_args()
    if arguments.near_misses:
        vehicle, pedestrian, count = recorded_slowing(eligible(from_table(read_near_misses(arguments.near_misses))))
        print(f"recorded: slower by a fifth: vehicle {vehicle:.0%}, pedestrian {pedestrian:.0%} of {count}")
    episodes = [(scenario, number) for number in range(arguments.episodes) for scenario in range(1, 9)]
    for name in [*arguments.weights, "no acceleration"]:
        weights = None if name == "no acceleration" else load_weights(weights_path(name))
        scenarios = load_scenarios(range(1, 9))
        outcomes = measure_outcomes(weights, scenarios=scenarios, episodes=episodes, batch=512, seed=arguments.seed)
        row = rates_with_intervals(outcomes)
        print(f"{name}: {row['critical_episodes']:.0f} critical of {len(episodes)} episodes")
        for rate in ("collision", "goal"):
            shares = [100.0 * row[f"{rate}_{part}"] for part in ("rate", "low", "high")]
            print("  {} {:.1f}% [{:.1f}, {:.1f}]".format(rate, *shares))
        print("  least CurvTTC quartiles " + ", ".join(f"{row[f'least_curvttc_{q}']:.2f} s" for q in (25, 50, 75)))
        if weights is not None:
            vehicle, pedestrian, count = slowing(weights, episodes, arguments.seed)
            print(f"  slower by a fifth: vehicle {vehicle:.0%}, pedestrian {pedestrian:.0%} of {count}")


if __name__ == "__main__":
    main()
