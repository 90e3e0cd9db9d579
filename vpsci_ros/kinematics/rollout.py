"""The roll-out: policies observe, act and move on through known kinematics, for training and for evaluation alike.

Its four parts are independent: where it starts, who acts (`ActorPair`, or anything that answers `Seen`), how many of
the scenes still move at each step, and by which kinematics they move.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from vpsci_ros.kinematics.scene import Scene, observe, time_to_collision
from vpsci_ros.kinematics.scene import advance as freely
from vpsci_ros.policy.actor import Actors, Distribution
from vpsci_ros.policy.sst import StepState
from vpsci_ros.world.observation import AGENTS

Actions = dict[str, Tensor]
"""Agent -> accelerations [B, 2] [m/s2], in the vehicle's heading frame."""


class Seen(NamedTuple):
    """What both agents know at a step of a roll-out of B scenes."""

    step: int
    scene: Scene
    observation: dict[str, Tensor]  # agent -> [B, 6], (6) and (7)
    curvttc: Tensor  # float64[B] [s]


def roll_out(
    start: Scene,
    act: Callable[[Seen], Actions],
    moving: Sequence[int],
    advance: Callable[[Scene, Actions], Scene] = freely,
) -> Iterator[Scene]:
    """Yield the scenes after each step of 0.1 s; where a number is not finite, one of NaN, and no more.

    :param start: B scenes.
    :param act: returns both agents' accelerations.
    :param moving: for each step, how many of the scenes take it: the first so many, fewer and fewer.
    :param advance: the kinematics.
    """
    scene = start
    for step, count in enumerate(moving):
        scene = Scene(*(part[:count] for part in scene))
        seen = Seen(step, scene, dict(zip(AGENTS, observe(scene), strict=True)), time_to_collision(scene))
        scene = advance(scene, act(seen))
        if not scene.finite:
            yield Scene(*(part * torch.nan for part in scene))
            return
        yield scene


class Draws(NamedTuple):
    """What stochastic actors draw before a roll-out, by agent.

    :ivar latent: float32[B, latent], who acts.
    :ivar noise: float32[B, 2], of the first step; the later steps' comes from torch's global generator.
    """

    latent: dict[str, Tensor]
    noise: dict[str, Tensor]


class ActorPair:
    """Both actors at work in a roll-out.

    :param memory: agent -> what its layers remember of the observed steps; moves on.
    :param before: the actions of the step before.
    :param draws: of stochastic actors; None: the deterministic middle.
    :param residual: returns what recorded people add to the means of actors without latent numbers, by agent, [B, 2].
    :param recorded: by agent, what it does [B, T, 2] [m/s2] at the first T steps whatever its actor says; NaN: the
        actor acts.
    :param bound: shortens the gradient of an action; None: gradients pass as they are.
    :ivar distribution: by agent, from which the last action was drawn.
    """

    def __init__(
        self,
        actors: Actors,
        memory: dict[str, list[StepState]],
        before: Actions,
        draws: Draws | None = None,
        residual: Callable[[Seen], Actions] | None = None,
        recorded: Mapping[str, Tensor] | None = None,
        bound: Callable[[Tensor], Tensor] | None = None,
    ) -> None:
        self._actors, self._memory, self.before, self._draws = actors, memory, before, draws
        self._recorded, self._bound, self._residual = recorded or {}, bound, residual
        self.distribution: dict[str, Distribution] = {}

    def __call__(self, seen: Seen) -> Actions:
        """Return what both do, and remember it."""
        added = None if self._residual is None else self._residual(seen)
        actions = {agent: self._act(agent, seen, None if added is None else added[agent]) for agent in AGENTS}
        for agent, known in self._recorded.items():
            if seen.step < known.shape[1]:
                done = known[: len(seen.curvttc), seen.step]
                actions[agent] = torch.where(done.isnan(), actions[agent], done)
        if self._bound is not None:
            for action in actions.values():
                if action.requires_grad:
                    action.register_hook(self._bound)
        self.before = actions
        return actions

    def _act(self, agent: str, seen: Seen, added: Tensor | None) -> Tensor:
        actor, memory, count = self._actors[agent], self._memory[agent], len(seen.curvttc)
        for state in memory:
            state.keep(count)
        known = seen.observation[agent], self.before[agent][:count], seen.curvttc, memory
        if added is not None:
            self.distribution[agent] = will = actor.distribution(*known, added.new_zeros(count, 0))
            return (will.mean + added).clamp(-actor.limit, actor.limit)
        if self._draws is None:
            return actor.step(*known)
        self.distribution[agent] = mean, scale = actor.distribution(*known, self._draws.latent[agent][:count])
        if seen.step:
            noise = self._draws.noise[agent][:count]
            self._draws.noise[agent] = actor.next_noise(noise, torch.randn_like(noise))
        return (mean + scale * actor.burst(self._draws.noise[agent][:count])).clamp(-actor.limit, actor.limit)
