"""Tables 3 and 5 of the paper: how much real data stage 1 needs, and how stage 2 should weight its rewards."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import NetworkConfig, PretrainConfig, RefineConfig
from vpsci_ros.learning.online import LOG as REFINE_LOG
from vpsci_ros.learning.online import refine
from vpsci_ros.learning.pretrain import LOG as PRETRAIN_LOG
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.learning.weights import Weights
from vpsci_ros.world import Scenario

SAMPLE_SIZES = (50, 100, 150, 200, 250, 336)
WEIGHTINGS: Mapping[str, tuple[float, ...]] = {
    "equal": (0.33, 0.33, 0.33),
    "safety": (0.60, 0.20, 0.20),
    "goal": (0.20, 0.60, 0.20),
    "speed": (0.20, 0.20, 0.60),
    "safety_goal": (0.45, 0.45, 0.10),
    "safety_speed": (0.45, 0.10, 0.45),
    "goal_speed": (0.10, 0.45, 0.45),
    "adaptive": (),
}
LAST = 0.1  # share of a run's iterations at its end that count as convergence


def sample_size_study(
    near_misses: pl.DataFrame,
    config: PretrainConfig,
    network: NetworkConfig,
    *,
    sizes: Sequence[int] = SAMPLE_SIZES,
    seed: int,
    out_dir: str | Path,
    report: Callable[[str], None] | None = None,
) -> pl.DataFrame:
    """Train stage 1 on subsets of the near misses (Table 3); return and write `table_3.csv`.

    A subset of n holds the first n interactions of one random order, so smaller ones are parts of larger ones. Rewards
    are those of the actors' own actions summed over an episode, mean over the last tenth of the run.

    :raises InvalidInput: a size exceeds the number of interactions.
    """
    out_dir = Path(out_dir)
    numbers = np.random.default_rng(seed).permutation(near_misses["interaction"].unique(maintain_order=True).to_numpy())
    rows = []
    for size in sizes:
        if size > len(numbers):
            raise InvalidInput(f"sizes: {size} interactions wanted, the near misses hold {len(numbers)}")
        subset = near_misses.filter(pl.col("interaction").is_in(numbers[:size].tolist()))
        weights = pretrain(subset, config, network, seed=seed, out_dir=out_dir / f"{size}")
        log = pl.read_csv(out_dir / f"{size}" / PRETRAIN_LOG).tail(max(1, int(LAST * config.episodes)))
        row: dict[str, Any] = {"interactions": size}
        for name in ("vehicle_reward", "pedestrian_reward", "vehicle_critic_loss", "pedestrian_critic_loss"):
            row[name] = log[name].mean()
        rows.append(row | weights.facts.get("held_out", {}).get("errors", {}))
        if report is not None:
            report(f"{size} interactions: vehicle reward {row['vehicle_reward']:.3g}")
    table = pl.DataFrame(rows)
    table.write_csv(out_dir / "table_3.csv")
    return table


def reward_weight_study(
    near_misses: pl.DataFrame,
    config: RefineConfig,
    weights: Weights,
    *,
    scenarios: Sequence[Scenario],
    episodes: Sequence[tuple[int, int]],
    batch: int,
    seed: int,
    out_dir: str | Path,
    weightings: Mapping[str, Sequence[float]] = WEIGHTINGS,
    report: Callable[[str], None] | None = None,
) -> pl.DataFrame:
    """Run stage 2 under each weighting of its rewards (Table 5); return and write `table_5.csv`.

    Rates are those of the last 1,000 critical episodes, errors those of the held-out near misses.
    """
    out_dir = Path(out_dir)
    rows = []
    for name, values in weightings.items():
        refine(
            near_misses,
            replace(config, reward_weights=list(values)),
            weights,
            scenarios=scenarios,
            episodes=episodes,
            batch=batch,
            seed=seed,
            out_dir=out_dir / name,
        )
        last = pl.read_csv(out_dir / name / REFINE_LOG).row(-1, named=True)
        kept = {
            key: value for key, value in last.items() if key.endswith("_rate") or key.startswith(("w_", "held_out_"))
        }
        rows.append({"weights": name} | kept)
        if report is not None:
            report(f"{name}: collisions {last['collision_rate']:.1%}, goals {last['goal_rate']:.1%}")
    table = pl.DataFrame(rows)
    table.write_csv(out_dir / "table_5.csv")
    return table
