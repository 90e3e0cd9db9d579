"""Stage 2: the pre-trained policies learn on from what happens to them in simulation (section 3.2).

The simulation replay buffer keeps a share of real experience for good; batches are drawn by (17); steps are rewarded by
(25)-(28), see `simulated_rewards`.

The actors follow the critics, as in the paper (`online_objective: ddpg`), or simulated seconds through the known
kinematics (`closed_loop`, see `foresight`); then their running average acts and is kept.

Sampling (17) and the speed reward alone let the actors forget people faster than the critics can tell them, so every
update also rehearses a few real near misses in closed loop (`imitation`), and adds that gradient to the policy's.

After every `updates_per_refresh` updates the held-out error is measured, and a refresh that exceeds stage 1's
closed-loop ADE by more than `rollback_margin` is undone.

What is kept in the end may lie a little on the way back to stage 1 (`stage_1_share`): networks between one and what was
made of it by further training often do better than either (Wortsman et al. 2022, 'Robust fine-tuning of zero-shot
models', https://arxiv.org/abs/2109.01903).
"""

import copy
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import torch
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.assembly import HistoryAssembler
from vpsci_ros.learning.checkpoint import load_checkpoint, save_checkpoint
from vpsci_ros.learning.config import AGENTS, PEDESTRIAN_GAIN, PretrainConfig, RefineConfig
from vpsci_ros.learning.divergence import check_losses
from vpsci_ros.learning.foresight import draw_moments, draw_scripted, foresee, start_at, step_along
from vpsci_ros.learning.held_out import HeldOut, split_as_before
from vpsci_ros.learning.imitation import draw, rollout_loss
from vpsci_ros.learning.interactions import from_table, table_hash
from vpsci_ros.learning.maddpg import Maddpg, UpdateResult
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.replay import Batch, ReplayBuffer, collate, pack, recorded_histories, unpack, up_to_capacity
from vpsci_ros.learning.simulated_rewards import SimulatedRewards
from vpsci_ros.learning.weights import Weights, resolved, save_weights, weights_to_bytes

RETURN_SMOOTHING = 0.02  # share of the newest episode in the running mean return (Figure 6)
WEIGHTS, CHECKPOINT = "refined.safetensors", "refine_checkpoint.safetensors"


class Refiner:
    """The learner of stage 2, fed with transitions by the `/replay` topic or in process.

    :param weights: of stage 1; its actors are the frozen reference of the speed reward.
    :param near_misses: near-miss table. Clips that stage 1 held out stay held out; if the weights do not name any of
        these clips, `refine_held_out_fraction` of the table is.
    :param seed: of sampling; the noise of the acting policies is theirs.
    :param out_dir: where `save` writes and a diverging batch is kept; None for a learner that writes nothing.
    :raises InvalidInput: too few near misses or clips.
    """

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
        training, held_out = split_as_before(near_misses, weights, config.refine_held_out_fraction, seed)
        self._held_out = HeldOut(held_out)
        self._networks = Networks.from_weights(weights)
        self._maddpg = Maddpg(
            self._networks,
            config,
            config.online_learning_rate,
            config.online_critic_learning_rate,
            config.value_unit,
            config.head_factor,
        )
        self._real = from_table(training)
        real = recorded_histories(self._real)
        room = max(1, int(config.real_capacity * config.buffer_capacity))
        kept = [real[i] for i in up_to_capacity(real, room, self._rng)]
        self._buffer = ReplayBuffer(config.buffer_capacity, kept, config.priority_exponent, config.real_bonus)
        self._assembler = HistoryAssembler(config.collision_reward, config.goal_reward)
        self._rewards = SimulatedRewards(config, self._networks)
        self.reward_weights = self._rewards.weights
        self.stage_1_errors = self._held_out.errors(weights)
        self.errors = dict(self.stage_1_errors)
        self._facts: dict[str, Any] = {"stage": "refined", "seed": seed, "data": {"sha256": table_hash(near_misses)}}
        self._facts["data"]["held_out_clips"] = sorted(set(self._held_out.interactions.clip))
        self._foresees = config.online_objective == "closed_loop"
        self._acting = "target_actor" if self._foresees else "actor"
        self._accepted = self._actor_state()
        self._credit, self._norm, self._calm, self._judged = 0.0, math.inf, 0, 0
        self._drawn, self._drawn_real = 0.0, 0.0
        self._refreshed = False
        self.updates, self.version, self.refreshes, self.rollbacks, self.episodes = 0, 1, 0, 0, 0
        self._last: dict[str, float] = {}
        self._returns = dict.fromkeys(AGENTS, 0.0)
        self.episode_returns: list[dict[str, float]] = []
        """The reward (27) of every episode so far, by agent, and its number: the raw material of Figure 6."""

    # ---- experience in

    def add(self, transitions: NDArray[np.void]) -> None:
        """Take transitions in, TRANSITION[n], in the order of their numbers; gaps in the numbers count as lost."""
        finished = self._assembler.add(transitions)
        self._credit += len(transitions)
        if finished:
            self._rewards.refer(finished)
        for history in finished:
            components = self._rewards.components(history)
            self.reward_weights.episode(np.mean([components[agent] for agent in AGENTS], axis=0))
            totals = {agent: float(self.reward_weights.total(components[agent]).sum()) for agent in AGENTS}
            for agent, total in totals.items():
                self._returns[agent] += RETURN_SMOOTHING * (total - self._returns[agent])
            self._buffer.append(history)
            self.episodes += 1
            self.episode_returns.append({"episode": self.episodes} | totals)
            if self.updates > self._judged:  # else nothing was learned from the last episode, and the norm is old
                self._judged = self.updates
                self._calm = self._calm + 1 if self._norm < self._config.gradient_tolerance else 0

    @property
    def received(self) -> int:
        """Transitions taken in so far."""
        return self._assembler.received

    @property
    def lost(self) -> int:
        """Transitions that never came, by the gaps in their numbers."""
        return self._assembler.lost

    @property
    def due(self) -> bool:
        """Whether there is enough new experience for another update."""
        return self.received >= self._config.warm_up_steps and self._credit >= self._config.steps_per_update

    @property
    def finished(self) -> bool:
        """Whether the policy gradient's norm has stayed below the tolerance for so many episodes (section 4.1).

        An episode counts if there was an update since the last one that did.
        """
        return self._calm >= self._config.converged_episodes

    # ---- learning

    def update(self) -> dict[str, float]:
        """Draw a batch, update all networks, and return the losses by name; `summary` has them too.

        :raises DivergedError: a loss is not a number; the batch is kept in `out_dir`.
        """
        self._credit -= self._config.steps_per_update
        histories = self._buffer.draw(self._config.batch_size, self._rng)
        batch = collate(histories)
        actors_rest = not self._foresees and self.updates < self._config.critic_warm_up
        follow = not (actors_rest or self._foresees)
        with torch.set_grad_enabled(not actors_rest):
            actions = self._maddpg.act(batch)
        scored = self._rewards.score(batch, actions, self._rng)
        self._slow_down()
        if follow:
            weight = self._config.rehearsal_weight
            result = self._maddpg.update(batch, scored, actions, weight * self._rehearse() if weight > 0.0 else None)
        else:
            result = self._maddpg.update(batch, scored, None)
        self._note(result, batch)
        if self._foresees:
            self._last |= self._look_ahead(batch, actions)
        check_losses(self._last, batch, self.updates, self._out_dir)
        self._buffer.reprioritise(histories, result.error)
        self.updates += 1
        if self.updates % self._config.updates_per_refresh == 0 and not actors_rest:
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
            "lost": self.lost,
            "dropped": self._assembler.dropped,
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

    def final(self) -> Weights:
        """Return `current` with its actors drawn towards those of stage 1 by `stage_1_share`, and measured anew."""
        stage_1 = Networks.from_weights(self._start).actor.state_dict()
        accepted = self._accepted[self._acting]
        drawn = {name: torch.lerp(part, stage_1[name], self._config.stage_1_share) for name, part in accepted.items()}
        return self._described(drawn, self._held_out.errors(self._described(drawn, self.errors)))

    def _described(self, actors: Mapping[str, torch.Tensor], errors: dict[str, float]) -> Weights:
        networks = copy.deepcopy(self._networks)
        networks.actor.load_state_dict(actors)
        held_out = {"errors": errors, "stage_1": self.stage_1_errors, "control": self._held_out.control}
        learned = {
            "updates": self.updates,
            "episodes": self.episodes,
            "reward_weights": self.reward_weights.values.tolist(),
        }
        facts = self._facts | {"held_out": held_out, "learned": learned}
        return networks.weights(self._start.configuration | resolved(self._config), facts)

    def weights(self) -> bytes:
        """Return the accepted weights as the bytes of a safetensors file, for `/policy/weights`."""
        return weights_to_bytes(self.current())

    def save(self) -> Path:
        """Write `final` to `out_dir` as `refined.safetensors` and return its path.

        :raises InvalidInput: there is no `out_dir`.
        """
        if self._out_dir is None:
            raise InvalidInput("Refiner.save: expected an output folder, got none; give out_dir")
        self._out_dir.mkdir(parents=True, exist_ok=True)
        save_weights(self._out_dir / WEIGHTS, self.final())
        return self._out_dir / WEIGHTS

    def save_checkpoint(self, path: str | Path, extra: dict[str, Any] | None = None) -> None:
        """Write all that `restore` needs to go on to the same result, and `extra` with it."""
        save_checkpoint(path, self._state() | {"extra": extra or {}})

    def restore(self, path: str | Path) -> dict[str, Any]:
        """Go on from a checkpoint of a learner of the same configuration, weights, data and seed; return its `extra`.

        :raises InvalidInput: not such a checkpoint.
        """
        state = load_checkpoint(path)
        for name, mine in self._identity().items():
            if state[name] != mine:
                raise InvalidInput(f"{path}: this checkpoint has another {name}: {state[name]}, expected {mine}")
        self._networks.load_state_dict(state["networks"])
        self._accepted = state["accepted"]
        self._maddpg.critic_optimiser.load_state_dict(state["optimisers"][0])
        self._maddpg.actor_optimiser.load_state_dict(state["optimisers"][1])
        self._rng.bit_generator.state = state["rng"]
        self._buffer.restore([unpack(h) for h in state["histories"]], state["highest"])
        self._assembler.restore(state["assembler"])
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
        names = ["updates", "version", "refreshes", "rollbacks", "episodes", "errors", "_credit", "_norm", "_calm"]
        names += ["_last", "_returns", "_refreshed", "episode_returns", "_judged", "_drawn", "_drawn_real"]
        return {
            **self._identity(),
            "networks": dict(self._networks.state_dict()),
            "accepted": {name: dict(part) for name, part in self._accepted.items()},
            "optimisers": [self._maddpg.critic_optimiser.state_dict(), self._maddpg.actor_optimiser.state_dict()],
            "rng": self._rng.bit_generator.state,
            "histories": [pack(h) for h in self._buffer.histories],
            "highest": self._buffer.highest,
            "assembler": self._assembler.state(),
            "reward_weights": self.reward_weights.values,
            "counters": {name: getattr(self, name) for name in names},
        }

    # ---- inside

    def _slow_down(self) -> None:
        """Give the actors the step size of this episode."""
        share = max(0.1, (1.0 - self._config.learning_rate_decay) ** self.episodes)
        for group in self._maddpg.actor_optimiser.param_groups:
            group["lr"] = self._config.online_learning_rate * group["factor"] * share

    def _look_ahead(self, batch: Batch, actions: Mapping[str, torch.Tensor]) -> dict[str, float]:
        """Improve the actors by what they lose in the next simulated seconds, and return it by name."""
        config, simulated = self._config, self._buffer.simulated
        if not simulated:
            return {}
        histories, at = draw_moments(simulated, config.foresight_rollouts, self._rng)
        collision, goal = foresee(
            self._networks.actor,
            start_at(histories, at),
            steps=config.foresight_steps,
            margin=config.clearance_margin,
            anticipation=config.clearance_ahead,
            pace=config.pace_weights,
            gain=PEDESTRIAN_GAIN,
            haste=config.haste_weight,
            scripted=draw_scripted(len(histories), config.braking_share, config.insisting_shares, self._rng),
        )
        rewards = [self._rewards.speed(batch, actions[agent], agent) for agent in AGENTS]
        strange = -(torch.stack(rewards) * batch.present).sum() / (len(AGENTS) * batch.present.sum())
        losses = {"collision": collision, "goal": goal, "speed": strange}
        weights = self.reward_weights.values * config.foresight_scale
        total = sum((float(w) * part for w, part in zip(weights, losses.values(), strict=True)), torch.zeros(()))
        self._norm = step_along(
            self._maddpg.actor_optimiser,
            self._networks.actor,
            total,
            self._rehearse(),
            config.rehearsal_weight,
            config.gradient_clip,
        )
        return {f"lost_{name}": float(part.detach()) for name, part in losses.items()} | {"gradient_norm": self._norm}

    def _rehearse(self) -> torch.Tensor:
        """Return the closed-loop error of a few real near misses, as stage 1 minimises it with its defaults."""
        rehearsal = PretrainConfig(rollouts=self._config.rehearsal_rollouts)
        start = draw(self._real, rehearsal, self._rng)
        position, velocity = rollout_loss(self._networks, self._real, start, rehearsal)
        return position + rehearsal.velocity_weight * velocity

    def _note(self, result: UpdateResult, batch: Batch) -> None:
        self._last = {f"{agent}_critic_loss": result.critic_loss[agent] for agent in AGENTS}
        if result.gradient_norm:
            self._norm = math.hypot(*result.gradient_norm.values())
            self._last |= {f"{agent}_actor_loss": result.actor_loss[agent] for agent in AGENTS}
            self._last["gradient_norm"] = self._norm
        steps = batch.present.sum(dim=1)
        drawn, real = float(steps.sum()), float((steps * batch.real).sum())
        self._drawn, self._drawn_real = self._drawn + drawn, self._drawn_real + real
        self._last |= {"real_share": real / drawn, "real_share_so_far": self._drawn_real / self._drawn}

    def _refresh(self) -> None:
        """Measure the held-out error and accept the actors, or go back to the last accepted ones."""
        self.refreshes += 1
        errors = self._held_out.errors(self._networks.weights({}, {}, actors=self._acting))
        limit = self.stage_1_errors["closed_loop_ade"] * (1.0 + self._config.rollback_margin)
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
