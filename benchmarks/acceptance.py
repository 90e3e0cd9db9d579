"""Share of simulated episodes that pass the four filters of section 3.3, by scenario, without learned policies.

    python benchmarks/acceptance.py [--episodes 500] [--seed 1]

"rule-based" has the autopilot and the walker all the time; "one brakes" hands over and lets one of the two brake by
2 m/s2 until it stands, the vehicle in odd episodes, the pedestrian in even ones: a stand-in for policies that evade.
"""

import argparse
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world import COLLISION, ENDED, RUNNING, World, WorldConfig, load_scenarios, observe
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.tick import Actions

BATCH = 1024
FRAMES, VEHICLE, PEDESTRIAN = 100, 10.0, 4.0  # at least so many frames, displacements above so many metres
PLACES = ("vehicle_x", "vehicle_y", "pedestrian_x", "pedestrian_y")


def one_brakes(state: NDArray[np.void]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Actions float64[B, 2] [m/s2]."""
    odd = state["episode"] % 2 == 1
    vehicle = np.stack([np.where(odd, -2.0, 0.0), np.zeros(len(state))], axis=1)
    velocity = observe(state)[1][:, :2].astype(np.float64)
    speed = np.maximum(np.hypot(*velocity.T), 0.2)  # twice 2 m/s2, of which (21) makes half
    return vehicle, np.where(odd[:, None], 0.0, -4.0 * velocity / speed[:, None])


def judged(config: WorldConfig, episodes: int, seed: int) -> NDArray[np.float64]:
    """Simulate; return scenario, critical, long enough, far enough, collision of each episode, float64[N, 5]."""
    world = World(
        config, load_scenarios(range(1, 9)), ((s, e) for e in range(episodes) for s in range(1, 9)), BATCH, seed
    )
    start, least, rows = np.zeros((4, BATCH)), np.full(BATCH, np.inf), []
    loop = Loop(world)
    while not world.done:
        state, curvttc = world.state, loop.assessment.curvttc
        fresh = (state["status"] == RUNNING) & (state["frame"] == 0)
        now = np.array([state[name] for name in PLACES])
        start[:, fresh], least[fresh] = now[:, fresh], np.inf
        least = np.minimum(least, curvttc)
        moved = np.hypot(*(now - start).reshape(2, 2, -1).transpose(1, 0, 2))
        over = state["status"] == ENDED
        passed = (least < CRITICAL_TTC, state["frame"] + 1 >= FRAMES, (moved[0] > VEHICLE) & (moved[1] > PEDESTRIAN))
        rows.append(np.array([state["scenario"], *passed, state["outcome"] == COLLISION], float)[:, over].T)
        loop.step(Actions(*one_brakes(state)))
    return np.concatenate(rows)


def main() -> None:
    """Simulate and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=500, help="of each scenario")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    paper = WorldConfig(spawn="paper", episode_time=10.0)
    alone = replace(paper, vehicle_driver="autopilot", pedestrian_driver="autopilot")
    for name, config in (("rule-based", alone), ("one brakes", paper)):
        rows = judged(config, options.episodes, options.seed)
        print(f"{name}\nscenario  critical  long enough  moved  kept  collisions among the kept")
        for scenario in range(1, 9):
            _, *passed, collided = rows[rows[:, 0] == scenario].T
            kept = np.logical_and.reduce(passed)
            critical, frames, far = (f"{part.mean():.0%}" for part in passed)
            text = f"{scenario:>8} {critical:>9} {frames:>12} {far:>6} {kept.mean():>5.0%}"
            print(f"{text} {collided[kept].mean() if kept.any() else 0.0:>10.0%}")


if __name__ == "__main__":
    main()
