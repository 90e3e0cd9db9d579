"""What importance sampling and splitting make of rare failures: whether their intervals cover, and what they save.

    python benchmarks/rare_failures.py OUT [--repetitions 100] [--budget 1000]

Drivers of `benchmarks/search.py`, that fail in about 4 to 0.03% of the episodes, drive a large pool once, which is the
truth; OUT keeps it. Then each method estimates the rate of that pool with a budget of episodes, again and
again: in none of them is an episode known before it is requested, and any can be requested twice, so that the pool is
the distribution itself. Drawing costs nothing, so the density of a proposal and thus the likelihood ratio is known.

- *random*: so many episodes, Wilson's interval.
- *cross-entropy*: 30% at random; then twice a proposal fitted to the episodes that came nearest, from what is known at
  the spawn, mixed with a fifth at random. All draws together by the balance heuristic, whose estimate is too low: each
  proposal is fitted to earlier draws, so that these weigh too little. Intervals: by the estimate's variance, on a log
  scale; and Fay and Feuer's for weighted sums, which counts what nobody has seen. Third, each draw weighs by the
  density alone that it was drawn from, which has no such bias.
- *splitting*: subset simulation with levels of a quarter by the least margin; each level goes on by a random walk to
  spawns like the present one (Metropolis on a graph of neighbours, one step in ten anywhere). Au and Beck's interval.
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gamma
from search import LateDriver
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.neighbors import NearestNeighbors

from vpsci_ros.cli.options import read_sections
from vpsci_ros.evaluation.statistics import wilson_interval
from vpsci_ros.exam.conduct import loop_with
from vpsci_ros.exam.config import MOVING
from vpsci_ros.exam.run import prepare
from vpsci_ros.exam.search.margin import LeastMargins, Watched
from vpsci_ros.resources import params_path
from vpsci_ros.world import COLLISION, ENDED
from vpsci_ros.world.tick import Actions

Floats = NDArray[np.float64]
DRIVERS = {
    "4%": (24, 0.7, 5.0, 20_000),
    "0.4%": (5, 1.7, 5.0, 40_000),
    "0.1%": (2, 2.5, 5.0, 40_000),
    "0.06%": (1, 2.5, 4.7, 100_000),
    "0.03%": (1, 2.5, 4.4, 100_000),
}
"""About how often it fails -> ticks by which it sees late, horizon [s], its speed [m/s], episodes of the pool."""
SEED, BATCH, NEIGHBOURS, Z = 2000, 1024, 20, 1.96
CROSS_ENTROPY = ("cross-entropy", "cross-entropy, Fay and Feuer", "cross-entropy, each draw by its own density")
SPAWN = ("vehicle_speed", "vehicle_acceleration", "vehicle_curvature", "cruise_throttle", "pedestrian_offset",
         "walking_speed", "start_delay", "approach_acceleration", "approach_phase", "lateral_comfort", "lane_sine",
         "lane_cosine", "walking_acceleration", "walking_phase", "walk_slope", "walk_sine", "walk_cosine")  # fmt: skip


class Pool(NamedTuple):
    """Episodes with what came of them.

    :ivar seen: float64[N, K], what is known at the spawn, each column with mean 0 and deviation 1.
    :ivar score: float64[N], least margin; -1 for a failure, above 0 else.
    :ivar walk: neighbours of each episode among spawns like it, symmetric.
    """

    seen: Floats
    score: Floats
    walk: list[NDArray[np.int64]]


class Estimate(NamedTuple):
    """A rate with its interval, and how many episodes were driven for it."""

    rate: float
    low: float
    high: float
    driven: int


def pool_of(folder: Path, name: str) -> Pool:
    """Return a driver's pool, which it drives unless the folder holds it."""
    late, horizon, cruise, size = DRIVERS[name]
    path = folder / f"pool_{late}_{horizon}_{cruise}_{size}.npz"
    if not path.is_file():
        np.savez(path, **driven(LateDriver(late, horizon, cruise), size, name))
    with np.load(path) as kept:
        seen, score = kept["seen"], np.where(kept["failed"], -1.0, np.maximum(kept["margin"], 1e-9))
    near = NearestNeighbors(n_neighbors=NEIGHBOURS + 1).fit(seen).kneighbors(return_distance=False)[:, 1:]
    one, other = np.repeat(np.arange(size), NEIGHBOURS), near.ravel()
    pairs = np.unique(np.concatenate([np.stack([one, other], 1), np.stack([other, one], 1)]), axis=0)
    return Pool(seen, score, np.split(pairs[:, 1], np.searchsorted(pairs[:, 0], np.arange(1, size))))


def driven(driver: LateDriver, size: int, name: str) -> dict[str, NDArray[Any]]:
    """Have a driver drive episodes; return `seen`, `margin` and `failed` of each."""
    exam = prepare(read_sections(params_path("ads_test"), [f"world_simulator.seed={SEED}"]))
    keys = [(scenario, number) for number in range(size // 8) for scenario in exam.run.scenarios]
    loop = loop_with(exam, "learned", "external", keys, BATCH)
    least, failed, seen = LeastMargins(Watched(exam.config)), set(), {}
    reported = 0
    while not loop.world.done:
        state = loop.world.now.state
        for record in state[state["frame"] == 0]:
            seen[int(record["scenario"]), int(record["episode"])] = spawn_of(record)
        step = loop.step(Actions(vehicle=driver.act(state)))
        state = step.tick.state
        least.add(state, step.assessment.curvttc)
        hit = (state["status"] == ENDED) & (state["outcome"] == COLLISION) & (state["vehicle_speed"] > MOVING)
        failed |= {(int(record["scenario"]), int(record["episode"])) for record in state[hit]}
        if len(least.found) >= reported + 10_000:
            reported = len(least.found)
            print(f"{name}: {reported} of {size} episodes, {len(failed)} fail", flush=True)
    columns = np.array([seen[key] for key in keys])
    return {
        "seen": (columns - columns.mean(axis=0)) / np.maximum(columns.std(axis=0), 1e-9),
        "margin": np.array([least.found[key] for key in keys]),
        "failed": np.array([key in failed for key in keys]),
    }


def spawn_of(record: np.void) -> list[float]:
    """Return what is known of an episode as it begins, the pedestrian as the vehicle sees it."""
    c, s = np.cos(record["vehicle_heading"]), np.sin(record["vehicle_heading"])
    dx, dy = record["pedestrian_x"] - record["vehicle_x"], record["pedestrian_y"] - record["vehicle_y"]
    vx, vy = record["pedestrian_vx"], record["pedestrian_vy"]
    place = [c * dx + s * dy, c * dy - s * dx, c * vx + s * vy, c * vy - s * vx]
    left = float(record["meeting_s"] - record["route_s"])
    return [
        *map(float, place),
        left,
        float(record["scenario"] > 4),
        *(min(10.0, float(record[name])) for name in SPAWN),
    ]


def at_random(pool: Pool, budget: int, rng: np.random.Generator) -> Estimate:
    """Estimate the rate from episodes drawn at random."""
    failures = int((pool.score[rng.integers(len(pool.score), size=budget)] < 0.0).sum())
    return Estimate(failures / budget, *wilson_interval(failures, budget), budget)


def cross_entropy(pool: Pool, budget: int, rng: np.random.Generator) -> list[Estimate]:
    """Estimate the rate by proposals that are fitted twice, as the `CROSS_ENTROPY` say."""
    size = len(pool.score)
    densities, chosen = [np.ones(size)], [rng.integers(size, size=3 * budget // 10)]
    for share, elite in ((0.2, 0.1), (0.5, 0.05)):
        drawn = np.concatenate(chosen)
        weight = 1.0 / mixture(densities, chosen)[drawn]
        order = np.argsort(pool.score[drawn])
        wanted = np.cumsum(weight[order]) <= elite * weight.sum()
        near = np.zeros(len(drawn), bool)
        near[order[wanted]] = True
        near |= pool.score[drawn] < 0.0
        model = HistGradientBoostingClassifier(max_iter=40, max_leaf_nodes=8, min_samples_leaf=5, random_state=0)
        model.fit(pool.seen[drawn], near, sample_weight=weight)
        tilted = model.predict_proba(pool.seen)[:, 1]
        densities.append(0.2 + 0.8 * tilted / tilted.mean())
        chosen.append(rng.choice(size, int(share * budget), p=densities[-1] / densities[-1].sum()))
    drawn = np.concatenate(chosen)
    n = len(drawn)
    weight = 1.0 / mixture(densities, chosen)
    value = np.where(pool.score[drawn] < 0.0, weight[drawn], 0.0) / n
    rate, most = float(value.sum()), float(weight.max()) / n
    variance = float((value**2).sum())
    mean, square = rate + most, variance + most**2  # as if one more of the greatest weight had been found
    upper = float(gamma.ppf(0.975, mean**2 / square, scale=square / mean))
    if rate == 0.0:
        return [Estimate(0.0, 0.0, upper, n)] * len(CROSS_ENTROPY)
    lower = float(gamma.ppf(0.025, rate**2 / variance, scale=variance / rate))
    own = np.concatenate([density.mean() / density[some] for density, some in zip(densities, chosen, strict=True)])
    by_own = np.where(pool.score[drawn] < 0.0, own, 0.0) / n
    return [on_log_scale(value), Estimate(rate, lower, upper, n), on_log_scale(by_own)]


def on_log_scale(value: Floats) -> Estimate:
    """Return the sum of weighted failures, float64[N], 0 for none, with the interval of its variance on a log scale."""
    rate = float(value.sum())
    spread = np.exp(Z * np.sqrt(max(float((value**2).sum()) - rate**2 / len(value), 0.0)) / rate)
    return Estimate(rate, rate / spread, rate * spread, len(value))


def mixture(densities: list[Floats], chosen: list[NDArray[np.int64]]) -> Floats:
    """Return the density of all draws together, as a multiple of the distribution's own, float64[N]."""
    total = sum(map(len, chosen))
    parts = zip(densities, chosen, strict=True)
    return np.sum([len(some) / total * density / density.mean() for density, some in parts], axis=0)


def splitting(pool: Pool, budget: int, rng: np.random.Generator, quarter: float = 0.25) -> Estimate:
    """Estimate the rate by subset simulation; it stops where the budget ends, with what the last level holds then."""
    count = budget // 4
    now = rng.integers(len(pool.score), size=count)
    cost, log_rate, variance = count, 0.0, 0.0
    chains = 1  # states of a chain: one each
    while True:
        score = pool.score[now]
        threshold = max(0.0, float(np.quantile(score, quarter)))
        inside = score < threshold if threshold > 0.0 else score < 0.0
        share = float(inside.mean())
        if share == 0.0:
            break
        log_rate += np.log(share)
        variance += (1.0 - share) / (share * count) * (1.0 + correlation(inside.reshape(-1, chains)))
        seeds = now[inside]
        if threshold <= 0.0:
            rate, spread = float(np.exp(log_rate)), float(np.exp(Z * np.sqrt(variance)))
            return Estimate(rate, rate / spread, min(1.0, rate * spread), cost)
        chains = max(2, count // len(seeds))
        states = [rng.permutation(seeds)[: count // chains]]
        for _ in range(chains - 1):
            moved, requested = step(pool, states[-1], threshold, rng)
            states.append(moved)
            cost += requested
        now = np.stack(states, axis=1).ravel()
        count = len(now)
        if cost > 2 * budget:
            break
    high = float(np.exp(log_rate + Z * np.sqrt(variance)) * 3.7 / count)
    return Estimate(0.0, 0.0, high, cost)


def step(pool: Pool, now: NDArray[np.int64], threshold: float, rng: np.random.Generator) -> tuple[Any, int]:
    """Return where a step of the random walk leads within the level, and how many episodes were driven for it."""
    out, requested = now.copy(), 0
    for place, here in enumerate(now):
        near = pool.walk[here]
        if rng.random() < 0.1:
            there = int(rng.integers(len(pool.score)))
        else:
            there = int(near[rng.integers(len(near))])
            if rng.random() > len(near) / len(pool.walk[there]):
                continue
        requested += 1
        if pool.score[there] < threshold:
            out[place] = there
    return out, requested


def correlation(inside: NDArray[np.bool_]) -> float:
    """Return Au and Beck's sum of the correlations along chains, of bool[chains, states]."""
    states, share = inside.shape[1], float(inside.mean())
    total = share * (1.0 - share)
    if states == 1 or total == 0.0:
        return 0.0
    lags = ((inside[:, k:] & inside[:, : states - k]).mean() - share**2 for k in range(1, states))
    return max(0.0, 2.0 * sum((1.0 - k / states) * lag / total for k, lag in enumerate(lags, start=1)))


def measured(pool: Pool, budget: int, repetitions: int) -> dict[str, dict[str, Any]]:
    """Return method -> how often its intervals cover, and what it saves."""
    methods: dict[str, Callable[[np.random.Generator], Any]] = {
        "random": lambda rng: [at_random(pool, budget, rng)],
        "cross-entropy": lambda rng: cross_entropy(pool, budget, rng),
        "splitting": lambda rng: [splitting(pool, budget, rng)],
    }
    truth = float((pool.score < 0.0).mean())
    out = {}
    for name, method in methods.items():
        runs = [method(np.random.default_rng((SEED, number))) for number in range(repetitions)]
        for which, found in zip(CROSS_ENTROPY if len(runs[0]) > 1 else [name], zip(*runs, strict=True), strict=True):
            rate, low, high, cost = (np.array(column) for column in zip(*found, strict=True))
            covered = int(((low <= truth) & (truth <= high)).sum())
            width = truth * (1.0 - truth) * (2.0 * Z / (high - low)) ** 2 / cost
            out[which] = {
                "truth": truth,
                "driven": float(cost.mean()),
                "mean": float(rate.mean()),
                "cover": covered / repetitions,
                "cover_interval": wilson_interval(covered, repetitions),
                "none_found": float((rate == 0.0).mean()),
                "saving_by_width": float(np.median(width)),
                "saving_by_error": truth * (1.0 - truth) / float(((rate - truth) ** 2).mean() * cost.mean()),
            }
    return out


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder for the pools and result.json")
    parser.add_argument("--repetitions", type=int, default=100)
    parser.add_argument("--budget", type=int, default=1000)
    parser.add_argument("--drivers", nargs="+", default=list(DRIVERS), choices=list(DRIVERS))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    result = {}
    heads = ("fails in", "method", "driven", "mean rate", "none found", "cover", "saving by width", "by error")
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for name in given.drivers:
        result[name] = measured(pool_of(given.out, name), given.budget, given.repetitions)
        for method, row in result[name].items():
            low, high = row["cover_interval"]
            cells = (f"{row['truth']:.3%}", method, f"{row['driven']:.0f}", f"{row['mean']:.3%}",
                     f"{row['none_found']:.0%}", f"{row['cover']:.2f} [{low:.2f}, {high:.2f}]",
                     f"{row['saving_by_width']:.1f}", f"{row['saving_by_error']:.1f}")  # fmt: skip
            print(f"| {' | '.join(cells)} |", flush=True)
    (given.out / "result.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
