"""Stage 2: the pre-trained policies learn on from what happens to them in simulation (section 3.2).

The simulation replay buffer keeps a share of real experience for good; batches are drawn by (17); steps are rewarded by
(25)-(28), see `rewards`. What the actors follow is `objective`, see `objectives`.

After every `refresh.updates` updates the held-out error is measured, and a refresh that exceeds stage 1's
closed-loop ADE by more than `refresh.rollback_margin` is undone.

What is kept in the end may lie a little on the way back to stage 1 (`refresh.stage_1_share`): networks between one and
what was made of it by further training often do better than either (Wortsman et al. 2022, 'Robust fine-tuning of
zero-shot models', https://arxiv.org/abs/2109.01903).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import torch
from numpy.typing import NDArray

from vpsci_ros.data.interactions import from_table, table_hash
from vpsci_ros.data.near_misses import clips_of
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.held_out import HeldOut, split_as_before
from vpsci_ros.learning.assembly import HistoryAssembler
from vpsci_ros.learning.checkpoint import load_checkpoint, save_checkpoint
from vpsci_ros.learning.config import PretrainConfig, RefineConfig
from vpsci_ros.learning.divergence import check_losses, require_finite_reward_weights
from vpsci_ros.learning.maddpg import Maddpg, UpdateResult
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.objectives import Training, find_objective
from vpsci_ros.learning.one_thread import one_thread
from vpsci_ros.learning.replay import Batch, History, ReplayBuffer, collate, recorded_histories, up_to_capacity
from vpsci_ros.learning.rewards import SimulatedRewards
from vpsci_ros.parameters import build
from vpsci_ros.policy.weights import Weights, resolved, save_weights, weights_to_bytes
from vpsci_ros.runs.identity import require_same
from vpsci_ros.world.observation import AGENTS

RETURN_SMOOTHING = 0.02  # share of the newest episode in the running mean return (Figure 6)
WEIGHTS, CHECKPOINT = "refined.safetensors", "refine_checkpoint.safetensors"


def value_factor(before: PretrainConfig | RefineConfig, now: RefineConfig, speed_weight: float) -> float:
    """Return what the values that were learned `before` have to be multiplied by, so that they mean the same return.

    Stage 1 knows the speed reward alone, with weight 1; in stage 2 it enters R of (27) by w_3, `speed_weight`.
    """
    unit = before.updates.value_unit / now.updates.value_unit
    if isinstance(before, RefineConfig):
        return unit
    return unit * speed_weight * now.rewards.speed_scaling / before.rewards.speed_scaling


class Refiner:
    """The learner of stage 2, fed with transitions by the `/replay` topic or in process.

    :param weights: of stage 1; its actors are the frozen reference of the speed reward.
    :param near_misses: near-miss table. Clips that stage 1 held out stay held out; if the weights do not name any of
        these clips, `refresh.held_out_fraction` of the table is.
    :param seed: of sampling; the noise of the acting policies is theirs.
    :param out_dir: where `save` writes and a diverging batch is kept; None for a learner that writes nothing.
    :raises InvalidInput: too few near misses or clips.
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
        training, held_out = split_as_before(near_misses, weights, config.refresh.held_out_fraction, seed)
        self._held_out = HeldOut(held_out)
        self._networks = Networks.from_weights(weights)
        self._maddpg = Maddpg(
            self._networks,
            config.updates,
            config.actors.learning_rate,
            config.actors.head_factor,
        )
        self._real = from_table(training, find_objective(config.objective).whole_tracks)
        real = recorded_histories(self._real)
        replay = config.replay
        room = max(1, int(replay.real_share * replay.capacity))
        kept = [real[i] for i in up_to_capacity(real, room, self._rng)]
        self._buffer = ReplayBuffer(replay.capacity, kept, replay.priority_exponent, replay.real_bonus)
        self.assembler = HistoryAssembler()
        self._rewards = SimulatedRewards(config.rewards, self._networks)
        self.reward_weights = self._rewards.weights
        self.stage_1_errors = self._held_out.errors(weights)
        self.errors = dict(self.stage_1_errors)
        self._facts: dict[str, Any] = {"stage": "refined", "seed": seed, "data": {"sha256": table_hash(near_misses)}}
        self._facts["data"]["held_out_clips"] = clips_of(held_out)
        self._facts["data"]["people"] = weights.facts.get("data", {}).get("people", [])
        objective = find_objective(config.objective)
        where = "the weights' configuration of stage 1"
        stage_1 = build(PretrainConfig, weights.configuration.get("PretrainConfig", {}), where)
        if objective.follows_critics:
            refined = weights.configuration.get("RefineConfig")
            before: PretrainConfig | RefineConfig = stage_1
            if refined is not None:  # of stage 2 the unit alone is needed
                unit = {name: value for name, value in refined.items() if name == "updates.value_unit"}
                before = build(RefineConfig, unit, "the weights' configuration of stage 2")
            self._networks.scale_values(value_factor(before, config, self.reward_weights.values[2]))
        start = Training(
            self._maddpg,
            self._rewards,
            self._real,
            stage_1,
            lambda: self.reward_weights.values,
            lambda: self._buffer.simulated,
        )
        self._acting, self._objective = objective.acting, objective.refine(start, config)
        self._accepted = self._actor_state()
        self._credit, self._norm, self._calm, self._tested = 0.0, math.inf, 0, 0
        self._drawn, self._drawn_real = 0.0, 0.0
        self._known: list[list[int]] = []
        """Scenario and number of the episodes that have paid for an update; where steps pay, none."""
        self._refreshed = False
        self.updates, self.version, self.refreshes, self.rollbacks, self.episodes = 0, 1, 0, 0, 0
        self.received = 0
        """Transitions taken in so far."""
        self._last: dict[str, float] = {}
        self._returns = dict.fromkeys(AGENTS, 0.0)
        self.episode_returns: list[dict[str, float]] = []
        """The reward (27) of every episode so far, by agent, and its number: the raw material of Figure 6."""

    @property
    def _price(self) -> int:
        """Steps, or else episodes, that pay for one update."""
        return max(1, self._config.updates.steps_per_update)

    def _new_episodes(self, finished: Sequence[NDArray[np.void]]) -> int:
        """Return how many episodes have histories among `finished` and had none before."""
        before = len(self._known)
        for history in finished:
            key = [int(history["scenario"][0]), int(history["episode"][0])]
            if key not in self._known:
                self._known.append(key)
        return len(self._known) - before

    # ---- experience in

    def add(self, transitions: NDArray[np.void]) -> None:
        """Take transitions in that came by `/replay`, TRANSITION[n], in the order of their numbers.

        Those that are not `transitions.usable` are refused and counted, and the rest of their history is dropped.
        """
        self.take(self.assembler.add(transitions), len(transitions))

    @one_thread()
    def take(self, finished: Sequence[NDArray[np.void]], transitions: int) -> None:
        """Take whole histories in, TRANSITION[T] each, as so many new transitions completed them."""
        self.received += transitions
        self._credit += transitions if self._config.updates.steps_per_update else self._new_episodes(finished)
        for history in self._rewards.histories(finished):
            components = self._rewards.components(history)
            self.reward_weights.episode(np.mean([components[agent] for agent in AGENTS], axis=0))
            totals = {agent: float(self.reward_weights.total(components[agent]).sum()) for agent in AGENTS}
            for agent, total in totals.items():
                self._returns[agent] += RETURN_SMOOTHING * (total - self._returns[agent])
            self._buffer.append(history)
            self.episodes += 1
            self.episode_returns.append({"episode": self.episodes} | totals)
            if self.updates > self._tested:  # else nothing was learned from the last episode, and the norm is old
                self._tested = self.updates
                self._calm = self._calm + 1 if self._norm < self._config.convergence.gradient_tolerance else 0

    @property
    def due(self) -> bool:
        """Whether there is enough new experience for another update."""
        return self.received >= self._config.updates.warm_up_steps and self._credit >= self._price

    @property
    def finished(self) -> bool:
        """Whether the policy gradient's norm has stayed below the tolerance for so many episodes (section 4.1).

        An episode counts if there was an update since the last one that did.
        """
        return self._calm >= self._config.convergence.episodes

    # ---- learning

    @one_thread()
    def update(self) -> dict[str, float]:
        """Draw a batch, update all networks, and return the losses by name; `summary` has them too.

        :raises DivergedError: a loss is not a number; the batch is kept in `out_dir`.
        """
        self._credit -= self._price
        histories = self._buffer.draw(self._config.replay.batch_size, self._rng)
        batch = collate(histories)
        self._slow_down()
        result = self._objective.update(batch, self.updates, self._rng)
        self._note(result, batch)
        check_losses(self._last, batch, self.updates, self._out_dir)
        self._buffer.reprioritise(histories, result.error)
        self.updates += 1
        if self.updates % self._config.refresh.updates == 0 and not result.rested:
            self._refresh()
        return dict(self._last)

    def take_refresh(self) -> bool:
        """Return whether `weights` has changed since the last call."""
        refreshed, self._refreshed = self._refreshed, False
        return refreshed

    def summary(self) -> dict[str, float]:
        """Return counters, losses, the share of real experience, reward weights and held-out errors, by name."""
        counters = {
            "updates": self.updates,
            "episodes": self.episodes,
            "transitions": self.received,
            "lost": self.assembler.lost,
            "dropped": self.assembler.dropped,
            "refused": self.assembler.refused,
            "version": self.version,
            "refreshes": self.refreshes,
            "rollbacks": self.rollbacks,
            "buffer_steps": self._buffer.steps,
        }
        weights = dict(zip(("w_collision", "w_goal", "w_speed"), map(float, self.reward_weights.values), strict=True))
        returns = {f"{agent}_return": value for agent, value in self._returns.items()}
        errors = {f"held_out_{name}": value for name, value in self.errors.items()}
        return counters | self._last | weights | returns | errors

    # ---- weights out

    def current(self) -> Weights:
        """Return the accepted actors and the critics as they are."""
        return self._described(self._accepted[self._acting], self.errors)

    @one_thread()
    def final(self) -> Weights:
        """Return `current`, its actors drawn towards those of stage 1 by `refresh.stage_1_share`, measured again.

        :raises VpsciError: what was learned is not finite.
        """
        share = self._config.refresh.stage_1_share
        stage_1 = Networks.from_weights(self._start).actor.state_dict()
        accepted = self._accepted[self._acting]
        drawn = {name: torch.lerp(part, stage_1[name], share) for name, part in accepted.items()}
        return self._described(drawn, self._held_out.errors(self._described(drawn, self.errors)))

    def _described(self, actors: Mapping[str, torch.Tensor], errors: dict[str, float]) -> Weights:
        require_finite_reward_weights(self.reward_weights.values)
        held_out = {"errors": errors, "stage_1": self.stage_1_errors, "control": self._held_out.control}
        learned = {
            "updates": self.updates,
            "episodes": self.episodes,
            "reward_weights": self.reward_weights.values.tolist(),
        }
        facts = self._facts | {"held_out": held_out, "learned": learned}
        weights = self._networks.weights(self._start.configuration | resolved(self._config), facts)
        tensors = {name.replace(".", "_actor.", 1): part.numpy().copy() for name, part in actors.items()}
        return replace(weights, tensors=weights.tensors | tensors)

    def weights(self) -> bytes:
        """Return the accepted weights as the bytes of a safetensors file, for `/policy/weights`."""
        return weights_to_bytes(self.current())

    def save(self) -> Weights:
        """Write `final` to `out_dir` as `refined.safetensors` and return it.

        :raises InvalidInput: there is no `out_dir`, or a tensor is not finite.
        :raises VpsciError: the reward weights are not finite.
        """
        if self._out_dir is None:
            raise InvalidInput("Refiner.save: expected an output folder, got none; give out_dir")
        self._out_dir.mkdir(parents=True, exist_ok=True)
        weights = self.final()
        save_weights(self._out_dir / WEIGHTS, weights)
        return weights

    def save_checkpoint(self, path: str | Path, extra: dict[str, Any] | None = None) -> None:
        """Write all that `restore` needs to go on to the same result, and `extra` with it."""
        save_checkpoint(path, self._state() | {"extra": extra or {}})

    def restore(self, path: str | Path) -> dict[str, Any]:
        """Go on from a checkpoint of a learner of the same configuration, weights, data and seed; return its `extra`.

        :raises InvalidInput: not such a checkpoint.
        """
        state = load_checkpoint(path)
        require_same(path, state, self._identity())
        self._networks.load_state_dict(state["networks"])
        self._accepted = state["accepted"]
        self._maddpg.critic_optimiser.load_state_dict(state["optimisers"][0])
        self._maddpg.actor_optimiser.load_state_dict(state["optimisers"][1])
        self._rng.bit_generator.state = state["rng"]
        self._buffer.restore([History(**fields) for fields in state["histories"]], state["highest"])
        self.reward_weights.values = state["reward_weights"]
        for name, value in state["counters"].items():
            setattr(self, name, value)
        extra: dict[str, Any] = state["extra"]
        return extra

    def _identity(self) -> dict[str, Any]:
        """Return what a checkpoint has to share with this learner."""
        return {
            "configuration": resolved(self._config),
            "starting weights": self._start.digest(),
            "seed": self._facts["seed"],
            "data": self._facts["data"],
        }

    def _state(self) -> dict[str, Any]:
        names = [
            "updates",
            "received",
            "version",
            "refreshes",
            "rollbacks",
            "episodes",
            "errors",
            "_credit",
            "_norm",
            "_calm",
        ]
        names += ["_last", "_returns", "_refreshed", "episode_returns", "_tested", "_drawn", "_drawn_real", "_known"]
        return {
            **self._identity(),
            "networks": dict(self._networks.state_dict()),
            "accepted": {name: dict(part) for name, part in self._accepted.items()},
            "optimisers": [self._maddpg.critic_optimiser.state_dict(), self._maddpg.actor_optimiser.state_dict()],
            "rng": self._rng.bit_generator.state,
            "histories": [dict(vars(history)) for history in self._buffer.histories],
            "highest": self._buffer.highest,
            "reward_weights": self.reward_weights.values,
            "counters": {name: getattr(self, name) for name in names},
        }

    # ---- inside

    def _slow_down(self) -> None:
        """Give the actors the step size of this episode."""
        share = max(0.1, (1.0 - self._config.actors.learning_rate_decay) ** self.episodes)
        for group in self._maddpg.actor_optimiser.param_groups:
            group["lr"] = self._config.actors.learning_rate * group["factor"] * share

    def _note(self, result: UpdateResult, batch: Batch) -> None:
        self._last = {f"{agent}_critic_loss": result.critic_loss[agent] for agent in AGENTS}
        if result.gradient_norm:
            self._last |= {f"{agent}_actor_loss": result.actor_loss[agent] for agent in AGENTS}
            self._last["gradient_norm"] = math.hypot(*result.gradient_norm.values())
        steps = batch.present.sum(dim=1)
        drawn, real = float(steps.sum()), float((steps * batch.real).sum())
        self._drawn, self._drawn_real = self._drawn + drawn, self._drawn_real + real
        self._last |= {"real_share": real / drawn, "real_share_so_far": self._drawn_real / self._drawn}
        self._last |= result.more
        self._norm = self._last.get("gradient_norm", self._norm)

    def _refresh(self) -> None:
        """Measure the held-out error and accept the actors, or go back to the last accepted ones."""
        self.refreshes += 1
        errors = self._held_out.errors(self._networks.weights({}, {}, actors=self._acting))
        limit = self.stage_1_errors["closed_loop_ade"] * (1.0 + self._config.refresh.rollback_margin)
        if errors["closed_loop_ade"] <= limit:
            self._accepted, self.errors = self._actor_state(), errors
            self.version += 1
            self._refreshed = True
            return
        self.rollbacks += 1
        self._networks.actor.load_state_dict(self._accepted["actor"])
        self._networks.target_actor.load_state_dict(self._accepted["target_actor"])
        self._maddpg.actor_optimiser.state.clear()

    def _actor_state(self) -> dict[str, dict[str, torch.Tensor]]:
        parts = {"actor": self._networks.actor, "target_actor": self._networks.target_actor}
        return {name: {k: v.detach().clone() for k, v in part.state_dict().items()} for name, part in parts.items()}
