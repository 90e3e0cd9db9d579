"""Stage 1: both agents learn from recorded near misses (Algorithm 1), by one of the `objectives`."""

import csv
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import torch

from vpsci_ros.data.corpus import held_out_by, table_hash
from vpsci_ros.data.interactions import from_table
from vpsci_ros.data.near_misses import clips_of
from vpsci_ros.errors import Stopped
from vpsci_ros.evaluation.held_out import HeldOut
from vpsci_ros.learning.checkpoint import load_checkpoint, save_checkpoint
from vpsci_ros.learning.divergence import require_finite
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.objectives import Maddpg, Training, find_objective
from vpsci_ros.learning.one_thread import one_thread
from vpsci_ros.learning.replay import Batch, draw_recorded
from vpsci_ros.learning.rewards import RecordedRewards, Tensors
from vpsci_ros.learning.training_config import PretrainConfig
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import Weights, resolved, save_weights
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.runs.identity import require_same
from vpsci_ros.world.observation import AGENTS

CHECKPOINT, WEIGHTS, LOG = "checkpoint.safetensors", "pretrained.safetensors", "log.csv"


Report = dict[str, float]


@one_thread()
def pretrain(
    near_misses: pl.DataFrame,
    config: PretrainConfig,
    network: NetworkConfig,
    *,
    seed: int,
    out_dir: str | Path,
    report: Callable[[Report], None] | None = None,
    beginning: Callable[[], AbstractContextManager[None]] = nullcontext,
) -> Weights:
    """Train both agents on near misses and write `pretrained.safetensors` and `log.csv` to `out_dir`.

    Training resumes from a checkpoint in `out_dir` of the same configuration, data and seed, to the same result. Where
    `report` raises `Stopped` or KeyboardInterrupt, a checkpoint is written before the exception is raised again. An
    interrupt within an iteration leaves the last checkpoint as it is. The log is written again at every held-out error
    and checkpoint, and however the run ends.

    :param near_misses: near-miss table; of it `config.held_out_clips` are kept for the held-out error.
    :param report: called after every iteration with `episode`, `episodes`, `seconds`, the losses and rewards of the
        iteration by name, and, where they were measured, the held-out errors [m] and, named `control_...`, those of
        the last velocity repeated.
    :param beginning: returns a context manager, entered for reading the near misses and again for compiling, before the
        first iteration: up to a minute without a result, so an exception may end it anywhere.
    :raises InvalidInput: too few near misses or clips, no clip begins with one of `held_out_clips`, no objective has
        the configuration's name, or a checkpoint of another run is in `out_dir`.
    :raises DivergedError: a loss is not finite.
    """
    out_dir = Path(out_dir)
    out_dir.mkdir(parents=True, exist_ok=True)
    with beginning():
        run = _Run(config, near_misses, seed, network)
        if (out_dir / CHECKPOINT).exists():
            run.restore(load_checkpoint(out_dir / CHECKPOINT), str(out_dir / CHECKPOINT))
    with beginning():
        run.compile()
    started = time.monotonic()
    try:
        while run.episode < config.episodes:
            run.whole = False
            losses, reward = run.iterate()
            due = run.episode % config.evaluate_every == 0 or run.episode == config.episodes
            held_out = run.held_out.errors(run.weights()) if run.held_out is not None and due else {}
            control = run.held_out.control if run.held_out is not None and due else {}
            row = losses | reward | held_out | {f"control_{name}": value for name, value in control.items()}
            run.log.append({"episode": run.episode} | row)
            run.whole = True
            if report is not None:
                values = {"episode": run.episode, "episodes": config.episodes, "seconds": time.monotonic() - started}
                report(values | row)
            if run.episode % config.checkpoint_every == 0:
                save_checkpoint(out_dir / CHECKPOINT, run.state())
            if due or run.episode % config.checkpoint_every == 0:
                write_log(out_dir / LOG, run.log)
    except (KeyboardInterrupt, Stopped):
        if run.whole:  # an interrupt within an iteration leaves the last checkpoint, since half an update is no state
            save_checkpoint(out_dir / CHECKPOINT, run.state())
        raise
    finally:
        if run.log:
            write_log(out_dir / LOG, run.log)
    weights = run.weights(final=True)
    save_weights(out_dir / WEIGHTS, weights)
    (out_dir / CHECKPOINT).unlink(missing_ok=True)
    return weights


class _Run:
    """The state of a stage-1 run between two iterations."""

    def __init__(self, config: PretrainConfig, table: pl.DataFrame, seed: int, network: NetworkConfig) -> None:
        self._config, self._seed = config, seed
        self.held_out: HeldOut | None = None
        self._facts: dict[str, Any] = {"stage": "pretrained", "seed": seed, "data": {"sha256": table_hash(table)}}
        training, held_out = held_out_by(table, config.held_out_clips)
        if held_out.height:
            self.held_out = HeldOut(held_out)
            self._facts["data"]["held_out_clips"] = clips_of(held_out)
        self.rng = np.random.default_rng(seed)
        interactions = from_table(training)
        self._interactions = interactions
        self._facts["data"] |= {"interactions": len(interactions), "steps": int(interactions.acted.sum())}
        torch.manual_seed(seed)
        self._networks = Networks(network)
        self._networks.set_statistics(*interactions.samples(), config.rewards.least_speed_deviation)
        self._maddpg = Maddpg(self._networks, config.updates)
        self._rewards, objective = RecordedRewards(config.rewards, self._networks), find_objective(config.objective)
        self._objective = objective.pretrain(Training(self._maddpg, self._rewards, interactions), config)
        self._optimisers = [self._maddpg.critic_optimiser, self._maddpg.actor_optimiser, *self._objective.optimisers]
        self.episode, self.whole = 0, True
        self.log: list[dict[str, float]] = []

    def compile(self) -> None:
        """Compile the kernels that the held-out errors need, so that no iteration waits for it."""
        if self.held_out is not None:
            self.held_out.errors(self.weights())

    def iterate(self) -> tuple[dict[str, float], dict[str, float]]:
        """Run one training iteration; return losses and rewards by name."""
        batch = draw_recorded(self._interactions, self._config.replay.batch_size, self.rng)
        result = self._objective.update(batch, self.episode, self.rng)
        losses = result.more | result.losses()
        require_finite(losses, f"update {self.episode}")
        self.episode += 1
        return losses, self._episode_rewards(batch, result.actions)

    def weights(self, final: bool = False) -> Weights:
        """Return the present weights; `final` adds the held-out errors to their facts."""
        facts: dict[str, Any] = dict(self._facts)
        configuration = resolved(self._config)
        if final and self.held_out is not None:
            errors = self.held_out.errors(self._networks.weights(configuration, facts))
            facts["held_out"] = {"errors": errors, "control": self.held_out.control}
        return self._networks.weights(configuration, facts)

    def _identity(self) -> dict[str, Any]:
        """Return configuration, seed and data hash, in which a checkpoint has to equal this run."""
        configuration = resolved(self._config, self._networks.config)
        return {"configuration": configuration, "seed": self._seed, "data": self._facts["data"]["sha256"]}

    def state(self) -> dict[str, Any]:
        """Return all that `restore` needs."""
        return {
            **self._identity(),
            "networks": dict(self._networks.state_dict()),
            "optimisers": [o.state_dict() for o in self._optimisers],
            "rng": self.rng.bit_generator.state,
            "episode": self.episode,
            "log": self.log,
        }

    def restore(self, state: dict[str, Any], where: str) -> None:
        """Resume from the state of a checkpoint.

        :raises InvalidInput: the checkpoint has another configuration, seed or data.
        """
        require_same(where, state, self._identity())
        self._networks.load_state_dict(state["networks"])
        for optimiser, saved in zip(self._optimisers, state["optimisers"], strict=True):
            optimiser.load_state_dict(saved)
        self.rng.bit_generator.state = state["rng"]
        self.episode, self.log = state["episode"], state["log"]

    def _episode_rewards(self, batch: Batch, actions: Tensors) -> dict[str, float]:
        rewards = {agent: self._rewards.speed(batch, actions[agent].detach(), agent) for agent in AGENTS}
        each = self._facts["data"]["steps"] / self._facts["data"]["interactions"]
        return {f"{agent}_reward": each * float(reward[batch.present].mean()) for agent, reward in rewards.items()}


def write_log(path: Path, rows: list[dict[str, float]]) -> None:
    """Write a CSV with a column for every name that occurs in `rows`, whole or not at all."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    with atomic_write(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names, restval="")
        writer.writeheader()
        writer.writerows(rows)
