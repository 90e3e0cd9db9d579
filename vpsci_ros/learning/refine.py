"""Stage 2: the pre-trained policies are trained further in simulation (section 3.2).

The simulation replay buffer keeps a share of real experience for good; batches are drawn by (17); steps are rewarded by
(25)-(28), see `rewards`. The actors are trained by `objective`, see `objectives`.

After every `refresh_every` updates the acting policies get the present actors. The weights that a training writes have
the running mean of the actors that acted (Polyak and Juditsky 1992, Acceleration of Stochastic Approximation by
Averaging). The mean does not act, so that it does not change the training; while the actors still learn fast, it lags
behind them (docs/stage_2.md).
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.corpus import split_as_before, table_hash
from vpsci_ros.data.interactions import from_table
from vpsci_ros.data.near_misses import clips_of
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.held_out import HeldOut
from vpsci_ros.learning.assembly import HistoryAssembler
from vpsci_ros.learning.checkpoint import load_checkpoint, save_checkpoint
from vpsci_ros.learning.divergence import require_finite
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.objectives import Maddpg, Training, UpdateResult, find_objective
from vpsci_ros.learning.one_thread import one_thread
from vpsci_ros.learning.replay import Batch, History, ReplayBuffer, collate, recorded_histories, up_to_capacity
from vpsci_ros.learning.rewards import SimulatedRewards
from vpsci_ros.learning.training_config import RefineConfig, SpeedRewardsConfig
from vpsci_ros.policy.weights import Weights, resolved, save_weights, weights_to_bytes
from vpsci_ros.runs.identity import require_same
from vpsci_ros.world.observation import AGENTS

RETURN_SMOOTHING = 0.02  # share of the newest episode in the running mean return (Figure 6)
CAPACITY = 40_000  # steps of the replay buffer: some 600 episodes; Table 8 has 10,000 "experiences" of unknown size
PRIORITY_EXPONENT, REAL_BONUS = 0.6, 0.2  # alpha and beta of the sampling probabilities (17)
REAL_STEPS = 3_000  # of the buffer that real experience keeps
GRADIENT_TOLERANCE, CALM_EPISODES = 1e-4, 100  # converged where the norm stays below for so long (section 4.1)
MEAN_REFRESHES = 10  # memory of the running mean of the actors
WEIGHTS, CHECKPOINT = "refined.safetensors", "refine_checkpoint.safetensors"


def value_factor(stage_1: dict[str, Any], now: RefineConfig, speed_weight: float) -> float:
    """Return the factor on the values of stage 1 with which they predict the return of stage 2.

    Stage 1 has the speed reward alone, with weight 1; in stage 2 the speed reward enters R of (27) by w_3,
    `speed_weight`.

    :param stage_1: the values of the `PretrainConfig` of stage 1.
    """
    before = stage_1.get("rewards.speed_scaling", SpeedRewardsConfig.speed_scaling)
    return speed_weight * now.rewards.speed_scaling / float(before)


@dataclass
class Progress:
    """The progress of stage 2, stored in checkpoints with networks, optimisers and experience.

    :ivar updates, episodes, received: numbers of updates made, episodes added and transitions received so far.
    :ivar owed: number of updates that are due for the episodes so far.
    :ivar version: of the weights that act; refreshes: how often these were replaced; refreshed: also since the last
        `take_refresh`.
    :ivar norm: of the last policy gradient, which has been below the tolerance for `calm` episodes; tested: the value
        of `updates` when an episode was last counted for `calm`.
    :ivar drawn, drawn_real: numbers of steps in all batches, and of the recorded ones among these.
    :ivar errors: held-out errors [m] of the mean actors.
    :ivar last: losses and norms of the last update, by name.
    :ivar returns: running mean of an episode's summed reward (27), by agent.
    :ivar episode_returns: number and summed rewards of every episode so far, the data of Figure 6.
    """

    updates: int = 0
    episodes: int = 0
    received: int = 0
    owed: float = 0.0
    version: int = 1
    refreshes: int = 0
    refreshed: bool = False
    norm: float = math.inf
    calm: int = 0
    tested: int = 0
    drawn: float = 0.0
    drawn_real: float = 0.0
    errors: dict[str, float] = field(default_factory=dict)
    last: dict[str, float] = field(default_factory=dict)
    returns: dict[str, float] = field(default_factory=lambda: dict.fromkeys(AGENTS, 0.0))
    episode_returns: list[dict[str, float]] = field(default_factory=list)


class Refiner:
    """The learner of stage 2, fed with transitions by the `/replay` topic or in process.

    :param weights: of stage 1; its actors are the frozen reference of the speed reward.
    :param near_misses: near-miss table. Clips that stage 1 held out stay held out; if the table has none of these, a
        fifth of it is held out, by whole clips.
    :param seed: of sampling; the noise of the acting policies is theirs.
    :param out_dir: where `save` writes; None for a learner that writes nothing.
    :raises InvalidInput: too few near misses or clips, or no objective has the configuration's name.
    """

    @one_thread()
    def __init__(
        self,
        config: RefineConfig,
        weights: Weights,
        near_misses: pl.DataFrame,
        *,
        seed: int,
        out_dir: str | Path | None = None,
    ) -> None:
        self._config, self._start = config, weights
        self._out_dir = None if out_dir is None else Path(out_dir)
        self._rng = np.random.default_rng(seed)
        training, held_out = split_as_before(near_misses, weights.facts.get("data", {}).get("held_out_clips", []))
        self._held_out = HeldOut(held_out)
        self._networks = Networks.from_weights(weights, config.updates.critics, seed)
        self._maddpg = Maddpg(self._networks, config.updates)
        interactions = from_table(training)
        real = recorded_histories(interactions)
        kept = up_to_capacity(real, REAL_STEPS, self._rng)
        self._buffer = ReplayBuffer(CAPACITY, [real[i] for i in kept], PRIORITY_EXPONENT, REAL_BONUS)
        self.assembler = HistoryAssembler()
        self._rewards = SimulatedRewards(config.rewards, self._networks)
        self.reward_weights = self._rewards.weights
        self.stage_1_errors = self._held_out.errors(weights)
        self.progress = Progress(errors=dict(self.stage_1_errors))
        self._facts: dict[str, Any] = {"stage": "refined", "seed": seed, "data": {"sha256": table_hash(near_misses)}}
        self._facts["data"]["held_out_clips"] = clips_of(held_out)
        if "RefineConfig" not in weights.configuration:
            stage_1 = weights.configuration.get("PretrainConfig", {})
            self._networks.scale_values(value_factor(stage_1, config, self.reward_weights.values[0, 2]))
        training_of = Training(self._maddpg, self._rewards, interactions, self._buffer)
        self._objective = find_objective(config.objective).refine(training_of, config)
        self._acting = self._actors()
        self._mean = self._acting

    def add(self, transitions: NDArray[np.void]) -> None:
        """Add transitions from `/replay`, TRANSITION[n], in the order of their numbers.

        Those that are not `transitions.usable` are refused and counted, and the rest of their history is dropped.
        """
        self.take(self.assembler.add(transitions), len(transitions))

    @one_thread()
    def take(self, finished: Sequence[NDArray[np.void]], transitions: int) -> None:
        """Add complete histories, TRANSITION[T] each, and count `transitions` further transitions as received."""
        progress = self.progress
        progress.received += transitions
        progress.owed += self._config.updates_per_episode * len(finished)
        for rows in finished:
            histories = self._rewards.histories([rows], self._config.updates.discount)
            sums = np.sum([self._rewards.components(history).sum(axis=1) for history in histories], axis=0)
            sums[:, :2] = self._rewards.events(rows)  # once, and not discounted
            self.reward_weights.episode(sums / np.count_nonzero(rows["acting"]))
            totals = dict(zip(AGENTS, map(float, (sums * self.reward_weights.values).sum(axis=1)), strict=True))
            for agent, total in totals.items():
                progress.returns[agent] += RETURN_SMOOTHING * (total - progress.returns[agent])
            for history in histories:
                self._buffer.append(history)
            progress.episodes += 1
            progress.episode_returns.append({"episode": progress.episodes} | totals)
            if progress.updates > progress.tested:  # else nothing was learned from the last one, and the norm is old
                progress.tested = progress.updates
                small = progress.norm < GRADIENT_TOLERANCE
                progress.calm = progress.calm + 1 if small else 0

    @property
    def due(self) -> bool:
        """Whether an update is due for an episode (Algorithm 1) and a batch is available."""
        return self.progress.received >= self._config.replay.batch_size and self.progress.owed >= 1.0

    @property
    def finished(self) -> bool:
        """Whether the norm of the policy gradient has stayed below the tolerance long enough (section 4.1).

        An episode counts if there was an update since the last episode that counted.
        """
        return self.progress.calm >= CALM_EPISODES

    @one_thread()
    def update(self) -> dict[str, float]:
        """Draw a batch, update all networks, and return the losses by name, which `summary` has, too.

        :raises DivergedError: a loss is not finite.
        """
        progress = self.progress
        progress.owed -= 1.0
        histories = self._buffer.draw(self._config.replay.batch_size, self._rng)
        batch = collate(histories)
        result = self._objective.update(batch, progress.updates, self._rng)
        self._note(result, batch)
        require_finite(progress.last, f"update {progress.updates}")
        if result.error is not None:
            self._buffer.reprioritise(histories, result.error)
        progress.updates += 1
        if progress.updates % self._config.refresh_every == 0:
            self._refresh()
        return dict(progress.last)

    def take_refresh(self) -> bool:
        """Return whether the acting weights were refreshed since the last call."""
        refreshed, self.progress.refreshed = self.progress.refreshed, False
        return refreshed

    def summary(self) -> dict[str, float]:
        """Return counters, losses, the share of real experience, reward weights and held-out errors, by name."""
        progress = self.progress
        counters = {
            "updates": progress.updates,
            "episodes": progress.episodes,
            "transitions": progress.received,
            "lost": self.assembler.lost,
            "dropped": self.assembler.dropped,
            "refused": self.assembler.refused,
            "version": progress.version,
            "refreshes": progress.refreshes,
            "buffer_steps": self._buffer.steps,
        }
        returns = {f"{agent}_return": value for agent, value in progress.returns.items()}
        errors = {f"held_out_{name}": value for name, value in progress.errors.items()}
        return counters | progress.last | self._reward_weights_by_name() | returns | errors

    def _reward_weights_by_name(self) -> dict[str, float]:
        names = [f"{agent}_w_{part}" for agent in AGENTS for part in ("collision", "goal", "speed")]
        return dict(zip(names, self.reward_weights.values.ravel().tolist(), strict=True))

    def acting(self) -> Weights:
        """Return the acting actors (of the last refresh), the present critics, and the mean actors' held-out errors."""
        return self._described(self._acting)

    def averaged(self) -> Weights:
        """Return the running mean of the acting actors, and the present critics."""
        return self._described(self._mean)

    @one_thread()
    def final(self) -> Weights:
        """Return `averaged`, refreshed if there were updates after the last refresh.

        :raises DivergedError: a reward weight is not finite.
        """
        if self.progress.updates % self._config.refresh_every:
            self._refresh()
        return self.averaged()

    def _described(self, actors: dict[str, NDArray[np.float32]]) -> Weights:
        progress = self.progress
        require_finite(self._reward_weights_by_name(), f"after {progress.updates} updates")
        held_out = {"errors": progress.errors, "stage_1": self.stage_1_errors, "control": self._held_out.control}
        learned = {
            "updates": progress.updates,
            "episodes": progress.episodes,
            "reward_weights": self.reward_weights.values.tolist(),
        }
        facts = self._facts | {"held_out": held_out, "learned": learned}
        present = self._networks.weights(self._start.configuration | resolved(self._config), facts)
        return replace(present, tensors=present.tensors | actors)

    def weights(self) -> bytes:
        """Return the bytes of a safetensors file of the acting weights, for `/policy/weights`."""
        return weights_to_bytes(self.acting())

    def save(self) -> Weights:
        """Write `final` to `out_dir` as `refined.safetensors` and return it.

        :raises InvalidInput: there is no `out_dir`, or a tensor is not finite.
        :raises DivergedError: a reward weight is not finite.
        """
        if self._out_dir is None:
            raise InvalidInput("Refiner.save: expected an output folder, got none; give out_dir")
        self._out_dir.mkdir(parents=True, exist_ok=True)
        weights = self.final()
        save_weights(self._out_dir / WEIGHTS, weights)
        return weights

    def save_checkpoint(self, path: str | Path, extra: dict[str, Any] | None = None) -> None:
        """Write a checkpoint from which `restore` resumes with the same result, with `extra` in it."""
        state = {
            **self._identity(),
            "networks": dict(self._networks.state_dict()),
            "acting": dict(self._acting),
            "mean": dict(self._mean),
            "optimisers": [optimiser.state_dict() for optimiser in self._optimisers()],
            "rng": self._rng.bit_generator.state,
            "histories": [dict(vars(history)) for history in self._buffer.histories],
            "highest": self._buffer.highest,
            "reward_weights": self.reward_weights.values,
            "progress": asdict(self.progress),
        }
        save_checkpoint(path, state | {"extra": extra or {}})

    def restore(self, path: str | Path) -> dict[str, Any]:
        """Resume from a checkpoint of the same configuration, weights, data and seed; return its `extra`.

        :raises InvalidInput: not such a checkpoint.
        """
        state = load_checkpoint(path)
        require_same(path, state, self._identity())
        self._networks.load_state_dict(state["networks"])
        self._acting, self._mean = state["acting"], state["mean"]
        for optimiser, saved in zip(self._optimisers(), state["optimisers"], strict=True):
            optimiser.load_state_dict(saved)
        self._rng.bit_generator.state = state["rng"]
        self._buffer.restore([History(**fields) for fields in state["histories"]], state["highest"])
        self.reward_weights.values = state["reward_weights"]
        self.progress = Progress(**state["progress"])
        extra: dict[str, Any] = state["extra"]
        return extra

    def _optimisers(self) -> list[Any]:
        return [self._maddpg.critic_optimiser, self._maddpg.actor_optimiser, *self._objective.optimisers]

    def _identity(self) -> dict[str, Any]:
        """Return configuration, starting weights, seed and data, in which a checkpoint has to equal this learner."""
        return {
            "configuration": resolved(self._config),
            "starting weights": self._start.digest(),
            "seed": self._facts["seed"],
            "data": self._facts["data"],
        }

    def _note(self, result: UpdateResult, batch: Batch) -> None:
        progress = self.progress
        last = result.losses()
        progress.norm = last.get("gradient_norm", progress.norm)
        steps = batch.present.sum(dim=1)
        drawn, real = float(steps.sum()), float((steps * batch.real).sum())
        progress.drawn, progress.drawn_real = progress.drawn + drawn, progress.drawn_real + real
        last |= {"real_share": real / drawn, "real_share_so_far": progress.drawn_real / progress.drawn}
        progress.last = last | result.more

    def _refresh(self) -> None:
        """Give the acting policies the present actors, add these to the mean actors, and measure the mean's errors."""
        progress = self.progress
        progress.refreshes += 1
        progress.version += 1
        progress.refreshed = True
        self._acting = self._actors()
        share = np.float32(1.0 / min(progress.refreshes, MEAN_REFRESHES))  # a plain mean until there are so many
        self._mean = {name: mean + share * (self._acting[name] - mean) for name, mean in self._mean.items()}
        progress.errors = self._held_out.errors(self.averaged())

    def _actors(self) -> dict[str, NDArray[np.float32]]:
        """Return the tensors of both actors, named as in a weights file."""
        return {name: part for name, part in self._networks.weights({}, {}).tensors.items() if "_actor." in name}
