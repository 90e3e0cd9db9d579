"""Table 3 of the paper: how much real data stage 1 needs.

Each size learns in a folder of its own. A study that was stopped goes on with what is missing, and
one that is repeated with more configurations runs only those.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.corpus import NO_CLIPS, held_out_by, table_hash
from vpsci_ros.data.interactions import Interactions, from_table
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.held_out import HeldOut, by_name
from vpsci_ros.evaluation.predictors import PolicyPredictor, Predictor, RepeatVelocity
from vpsci_ros.evaluation.protocols import continued, reconstruct
from vpsci_ros.extras.paper.published import TABLE_3
from vpsci_ros.extras.paper.studies.networks import Report
from vpsci_ros.extras.paper.studies.state import StudyReport, is_made, once, side_by_side
from vpsci_ros.learning import pretrain as stage_1
from vpsci_ros.learning.training_config import PretrainConfig
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import load_weights, resolved
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.runs.workers import HERE, Site
from vpsci_ros.world.observation import AGENTS

SAMPLE_SIZES = tuple(TABLE_3)
REPEATED, FADING = "repeat_velocity", "fading_acceleration"  # controls of Table 3
LAST = 0.1  # share of a run's iterations at its end that count as convergence


def sample_size_study(
    near_misses: pl.DataFrame,
    config: PretrainConfig,
    network: NetworkConfig,
    *,
    sizes: Sequence[int] = SAMPLE_SIZES,
    seed: int,
    out_dir: str | Path,
    site: Site = HERE,
    report: StudyReport = lambda *_: None,
) -> pl.DataFrame:
    """Train stage 1 on subsets of the near misses (Table 3); return and write `table_3.csv`, the control as last row.

    The same whole clips are held out for all sizes (`config.held_out_clips`), and a subset of n holds the first n
    interactions of one random order, so smaller ones are parts of larger ones. The order ends with the held-out
    interactions: a size that needs them has no held-out errors.

    Columns: `interactions`; of the last tenth of the run, means of `vehicle_reward` and `pedestrian_reward` (of the
    actors' own actions, summed over an interaction) and of each `..._critic_loss`; on the held-out clips, ADE and FDE
    [m] of both protocols, and `..._held_out_reward`: (14)-(15) summed over the critical steps of an interaction, with
    the deviations of the whole table, so that sizes compare. Rewards in training use those of the subset.

    :param site: where the sizes are learned.
    :param report: called with the configuration's name (the size) and what `pretrain` reports.
    :raises InvalidInput: a size is not from 2 to the number of interactions, or `out_dir` holds another study.
    """
    pool, kept_out = held_out_by(near_misses, config.held_out_clips)
    rng = np.random.default_rng(seed)
    numbers = (part["interaction"].unique().sort().to_numpy() for part in (pool, kept_out))
    order = np.concatenate([rng.permutation(part) for part in numbers])
    for size in sizes:
        if not 2 <= size <= len(order):
            raise InvalidInput(f"sizes: expected 2 to {len(order)} interactions, as the near misses hold, got {size}")
    config = replace(config, held_out_clips=[NO_CLIPS])
    deviation = _deviation(from_table(near_misses), config.rewards.least_speed_deviation)
    rewards = partial(_held_out_rewards, deviation, config.rewards.speed_scaling)
    held_out = HeldOut(kept_out) if kept_out.height else None
    out_dir = Path(out_dir)
    learner = _Sizes(near_misses, order, pool["interaction"].n_unique(), config, network, seed, held_out, rewards)
    side_by_side(site, learner.row, [n for n in sizes if not is_made(out_dir / f"{n}")], out_dir, report)
    rows = [{"interactions": f"{n}"} | learner.row(out_dir, n, report) for n in sizes]
    if held_out is not None:
        control = held_out.control | rewards(RepeatVelocity(), held_out.interactions)
        rows.append({"interactions": REPEATED} | control)
        rows.append({"interactions": FADING} | by_name(continued(held_out.interactions)))
    return _written(rows, out_dir / "table_3.csv")


@dataclass(frozen=True)
class _Sizes:
    """The trainings of Table 3.

    :ivar order: numbers of the interactions, of which a size takes the first ones.
    :ivar most: interactions that are not held out.
    :ivar rewards: returns the rewards of a model on held-out interactions.
    """

    near_misses: pl.DataFrame
    order: NDArray[np.int64]
    most: int
    config: PretrainConfig
    network: NetworkConfig
    seed: int
    held_out: HeldOut | None
    rewards: Callable[[Predictor, Interactions], dict[str, float]]

    def row(self, out_dir: Path, size: int, report: StudyReport = lambda *_: None) -> dict[str, Any]:
        """Return the row of a size, learned in its folder unless it is there."""
        identity = resolved(self.config, self.network) | {"seed": self.seed, "data": table_hash(self.near_misses)}
        folder = out_dir / f"{size}"
        return once(folder, identity, partial(self._made, folder, size, partial(report, f"{size}")))

    def _made(self, folder: Path, size: int, report: Report) -> dict[str, Any]:
        subset = self.near_misses.filter(pl.col("interaction").is_in(self.order[:size].tolist()))
        if not (folder / stage_1.WEIGHTS).exists() or (folder / stage_1.CHECKPOINT).exists():
            stage_1.pretrain(subset, self.config, self.network, seed=self.seed, out_dir=folder, report=report)
        weights = load_weights(folder / stage_1.WEIGHTS)
        log = pl.read_csv((folder / stage_1.LOG).read_bytes()).tail(max(1, int(LAST * self.config.episodes)))
        names = [f"{agent}_{what}" for what in ("reward", "critic_loss") for agent in AGENTS]
        values: dict[str, Any] = {name: log[name].mean() for name in names}
        if self.held_out is None or size > self.most:
            return values
        held_out = self.held_out
        return values | held_out.errors(weights) | self.rewards(PolicyPredictor(weights), held_out.interactions)


def _written(rows: list[dict[str, Any]], path: Path) -> pl.DataFrame:
    table = pl.DataFrame(rows, infer_schema_length=None)
    with atomic_write(path) as part:
        table.write_csv(part)
    return table


def _deviation(interactions: Interactions, least: float) -> dict[str, NDArray[np.float64]]:
    """Return the deviations of the next speeds, float64[2] [m/s] by agent, as `Networks.set_statistics` takes them."""
    deviations = {}
    for agent in AGENTS:
        speeds = interactions.next_velocity[agent][interactions.acted].astype(np.float64)
        mean = speeds.mean(axis=0) * [1.0, 0.0]
        deviations[agent] = np.maximum(np.sqrt(((speeds - mean) ** 2).mean(axis=0)), least)
    return deviations


def _held_out_rewards(
    deviation: Mapping[str, NDArray[np.float64]], scaling: float, model: Predictor, interactions: Interactions
) -> dict[str, float]:
    squares = reconstruct(model, interactions).squares
    rewards = {}
    for i, agent in enumerate(AGENTS):
        own = squares[:, 2 * i : 2 * i + 2] / deviation[agent] ** 2
        rewards[f"{agent}_held_out_reward"] = -scaling * float(own.sum(axis=1).mean())
    return rewards
