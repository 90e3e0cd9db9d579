"""How critical episodes end under policies, who slows down, and how near they come: the figures of the model card.

    python benchmarks/outcomes.py [--episodes 250] [--seed 20261125] [--weights people closed_loop] [--scenarios 1 2]
                                       [--near-misses near_misses.parquet] [--world spawn=paper episode_time=10 ...]

Without exploration; the unit is the episode that becomes critical; 95% Wilson intervals. An episode goes on alike
whatever its limit, so the shares after 10 s are those of a limit of 10 s. `--world` sets parameters of `WorldConfig`;
the paper's scenes: spawn=paper episode_time=10 pedestrian_gain=0.5 release_time=0.5 lane_following=false. Controls are
no acceleration at all, and the acceleration of the hand-over, which fades. With several pedestrians only the shares of
outcomes are printed. With near misses, also who slows down in these, between the first critical step and the last of
those that stay critical for a second, how far pedestrians leave their line meanwhile, and how near people came who met
so late: where an encounter begins bounds how far it can be kept off, and simulated ones begin later (`ONSETS`). Half a
minute.
"""

import argparse
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.data.interactions import Interactions, from_table
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.evaluation.outcomes import NoAcceleration, measure_outcomes
from vpsci_ros.evaluation.protocols import eligible
from vpsci_ros.extras.paper.rates import rates_with_intervals
from vpsci_ros.parameters import build
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.policy_file import Policy, load_policy
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.policy.weights import Weights, load_weights
from vpsci_ros.resources import weights_path
from vpsci_ros.world import COLLISION, GOAL, World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Agent, Loop
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.state import ENDED, RUNNING

SLOWER = 0.8  # of the speed at the hand-over
STANDING = 0.3  # [m/s] below this a pedestrian has no direction
TIMES = (7.5, 10.0, 12.5, 15.0, 20.0, 30.0)  # [s] after the spawn
ONSETS = (0.0, 1.5, 2.5, 3.5, 4.5, 5.0)  # [s] classes of CurvTTC at the first critical moment


class Watched(NamedTuple):
    """What critical episodes were like.

    vehicle_slower, pedestrian_slower, again bool[N]: slower under the policies by a fifth; handed over more than once.
    onset float64[N]: CurvTTC [s] at the first critical moment. aside float64[N]: how far [m] the pedestrian leaves the
    line that it walks on then, up to the last critical moment; NaN where it stands. seconds, outcome: when it ended
    [s], and how.
    """

    vehicle_slower: NDArray[np.bool_]
    pedestrian_slower: NDArray[np.bool_]
    again: NDArray[np.bool_]
    onset: NDArray[np.float64]
    aside: NDArray[np.float64]
    seconds: NDArray[np.float64]
    outcome: NDArray[np.int64]


def watched(weights: Policy | None, config: WorldConfig, episodes: list[tuple[int, int]], seed: int) -> Watched:
    """Simulate the episodes and look at those that become critical, from then on; `onset` is CurvTTC then."""
    world = World(config, load_scenarios({scenario for scenario, _ in episodes}), episodes, 512, seed)
    agents: dict[str, Agent] = dict.fromkeys(AGENTS, NoAcceleration())
    if weights is not None:
        agents = dict(policies(weights, world))
    seen: dict[tuple[int, int], list[tuple[float, ...]]] = defaultdict(list)
    ended: dict[tuple[int, int], tuple[float, int]] = {}
    for step in Loop(world, agents=agents):
        for row, curvttc, critical in zip(
            step.tick.state, step.assessment.curvttc, step.assessment.critical, strict=True
        ):
            key = int(row["scenario"]), int(row["episode"])
            if row["status"] == ENDED:
                ended[key] = row["frame"] * config.tick, int(row["outcome"])
            if row["status"] == RUNNING and (critical or key in seen):
                motion = [row[f"pedestrian_{part}"] for part in ("x", "y", "vx", "vy")]
                walking = np.hypot(*motion[2:])
                seen[key].append((row["vehicle_speed"], walking, row["controlled"], curvttc, critical, *motion))
    rows = []
    for key, a in zip(seen, map(np.array, seen.values()), strict=True):
        speeds, held, critical = a[:, :2], a[:, 2] > 0, np.flatnonzero(a[:, 4] > 0)
        if held.any():  # else the danger was over before the policies' next tick
            slower = speeds[held].min(axis=0) < SLOWER * speeds[held][0]
            again = np.count_nonzero(np.diff(held.astype(int)) == 1) > 1
            rows.append((*slower, again, a[0, 3], sideways(a[: critical[-1] + 1, 5:]), *ended[key]))
    return Watched(*(np.array(column) for column in zip(*rows, strict=True)))


def by_time(seen: Watched, limit: float) -> str:
    """Return the shares that have collided, and have reached both goals, by several times up to `limit` [s]."""
    parts = []
    for seconds in sorted({*(t for t in TIMES if t < limit), limit}):
        shares = [np.mean((seen.outcome == kind) & (seen.seconds <= seconds + 1e-6)) for kind in (COLLISION, GOAL)]
        parts.append("{:g} s {:.1f}%, {:.1f}%".format(seconds, *(100.0 * share for share in shares)))
    return "; ".join(parts)


def sideways(walk: NDArray[np.float64]) -> float:
    """Return the greatest distance [m] of a walk, float64[T, 4] of x, y, vx, vy, from the line that it begins along."""
    away, ahead = walk[:, :2] - walk[0, :2], walk[0, 2:]
    pace = float(np.hypot(*ahead))
    return float(np.abs(away[:, 0] * ahead[1] - away[:, 1] * ahead[0]).max() / pace) if pace > STANDING else np.nan


def recorded_distances(interactions: Interactions, simulated: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quartiles [s] of the least CurvTTC of recorded near misses, weighted to the onsets of simulated ones.

    :param simulated: float64[N] [s], CurvTTC at the first critical moment of simulated episodes.
    """
    rows = np.arange(len(interactions))
    onset, least = interactions.curvttc[rows, interactions.first], interactions.curvttc.min(axis=1)
    place = np.digitize(onset, ONSETS[1:-1])
    share = np.bincount(np.digitize(simulated, ONSETS[1:-1]), minlength=len(ONSETS) - 1) / len(simulated)
    weight = share[place] / np.bincount(place, minlength=len(ONSETS) - 1)[place]
    order = np.argsort(least)
    reached = np.cumsum(weight[order]) / weight.sum()
    return np.array([least[order][np.searchsorted(reached, q)] for q in (0.25, 0.5, 0.75)])


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


def fading() -> Weights:
    """Return networks that add nothing, so that the acceleration with which an agent comes goes on and fades."""
    own = load_weights(weights_path("closed_loop"))
    last = [f"{agent}_actor.head.4.{part}" for agent in AGENTS for part in ("weight", "bias")]
    return replace(own, tensors=own.tensors | {name: 0.0 * own.tensors[name] for name in last})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=250, help="in each scenario")
    parser.add_argument("--seed", type=int, default=20261125, help="of the world; another one than training had")
    parser.add_argument(
        "--weights", nargs="+", default=["people", "closed_loop", "ma_sst_ddpg"], help="files or shipped names"
    )
    parser.add_argument("--scenarios", type=int, nargs="+", default=[*range(1, 9)], help="numbers")
    parser.add_argument("--world", nargs="+", default=[], metavar="NAME=VALUE", help="parameters of the world")
    parser.add_argument("--near-misses", type=Path, help="near-miss table")
    parser.add_argument(
        "--keeping", nargs="+", default=[], choices=AGENTS, help="agents that keep their velocity instead"
    )
    arguments = parser.parse_args()
    near_misses = from_table(read_near_misses(arguments.near_misses)) if arguments.near_misses else None
    if near_misses is not None:
        vehicle, pedestrian, count = recorded_slowing(eligible(near_misses))
        print(f"recorded: slower by a fifth: vehicle {vehicle:.0%}, pedestrian {pedestrian:.0%} of {count}")
        whole = eligible(near_misses)
        walks = [whole.motion[i, whole.first[i] : whole.last[i] + 1, 5:9] for i in range(len(whole))]
        print(f"  aside of its line: {_spread([sideways(walk) for walk in walks])}")
        rows = np.arange(len(near_misses))
        onset, least = near_misses.curvttc[rows, near_misses.first], near_misses.curvttc.min(axis=1)
        print(f"  CurvTTC quartiles of {len(rows)}: at first {_quartiles(onset)}, least {_quartiles(least)}")
    episodes = [(scenario, number) for number in range(arguments.episodes) for scenario in arguments.scenarios]
    settings = {name: yaml.safe_load(value) for name, _, value in (text.partition("=") for text in arguments.world)}
    world, scenarios = build(WorldConfig, settings, "--world"), load_scenarios(arguments.scenarios)
    controls: dict[str, Policy | None] = {"no acceleration": None, "fading acceleration": fading()}
    for name, weights in [*((name, load_policy(name)) for name in arguments.weights), *controls.items()]:
        simulation = SimulationConfig(scenarios, episodes, 512, arguments.seed, world)
        outcomes = measure_outcomes(weights, simulation, arguments.keeping)
        row = rates_with_intervals(outcomes)
        print(f"{name}: {row['critical_episodes']:.0f} critical of {len(episodes)} episodes")
        for rate in ("collision", "goal"):
            shares = [100.0 * row[f"{rate}_{part}"] for part in ("rate", "low", "high")]
            print("  {} {:.1f}% [{:.1f}, {:.1f}]".format(rate, *shares))
        if arguments.keeping or world.pedestrians > 1:
            continue
        seen = watched(weights, world, episodes, arguments.seed)
        print(f"  collided and at both goals by time: {by_time(seen, world.episode_time)}")
        print(f"  CurvTTC quartiles: at first {_quartiles(seen.onset)}, least {_quartiles(outcomes.least_curvttc)}")
        if near_misses is not None:
            told = ", ".join(f"{q:.2f} s" for q in recorded_distances(near_misses, seen.onset))
            print(f"  least of recorded ones with such a first: {told}")
        vehicle, pedestrian, again = (float(column.mean()) for column in seen[:3])
        print(f"  slower by a fifth: vehicle {vehicle:.0%}, pedestrian {pedestrian:.0%} of {len(seen.onset)}")
        print(f"  aside of its line: {_spread(seen.aside)}")
        print(f"  handed over again after they were given back: {again:.0%}")
        struck = seen.outcome == COLLISION
        if struck.any():
            print(f"  of {struck.sum()} collisions after a further hand-over: {seen.again[struck].mean():.0%}")


def _spread(distances: ArrayLike) -> str:
    known = np.asarray(distances)[~np.isnan(distances)]
    parts = ", ".join(f"{q:.2f} m" for q in np.percentile(known, (50, 75, 90)))
    return f"median, third quartile and ninth decile of {len(known)}: {parts}"


def _quartiles(values: ArrayLike) -> str:
    return ", ".join(f"{q:.2f} s" for q in np.percentile(np.asarray(values), (25, 50, 75)))


if __name__ == "__main__":
    main()
