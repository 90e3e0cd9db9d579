"""How critical episodes end under policies, and who slows down: the figures of the model card.

    python test/benchmarks/outcomes.py [--episodes 120] [--seed 90210] [--weights refined pretrained]

Without exploration; the unit is the episode that becomes critical; 95% Wilson intervals. Controls: the unrefined
weights, and no acceleration at all. Some seconds.
"""

import argparse
from collections import defaultdict

import numpy as np

from vpsci_ros.learning.measured import measure_outcomes, rates_with_intervals
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=120, help="in each scenario")
    parser.add_argument("--seed", type=int, default=90210, help="of the world; another one than training had")
    parser.add_argument("--weights", nargs="+", default=["refined", "pretrained"], help="files or shipped names")
    arguments = parser.parse_args()
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
