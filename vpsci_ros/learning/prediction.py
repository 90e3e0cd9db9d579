"""How predictors of trajectories learn from recorded near misses: each by the loss of its own paper.

Moments are drawn as for stochastic policies, half of them near the onset, with up to ten observed steps before and 3 s
after. MultiPath++ takes the negative logarithm of its mixture's likelihood, of the plan that comes nearest; DenseTNT
the cross entropy of the goal nearest to where the agent came, and the distance of the way that is completed to there;
Social-LSTM the likelihood of the next acceleration at every observed step.
"""

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.errors import InvalidInput
from vpsci_ros.kinematics.scene import Scene, advance, scene_at, to_heading_frame
from vpsci_ros.learning.config import PretrainConfig
from vpsci_ros.learning.descent import WEIGHT_DECAY, Descent
from vpsci_ros.learning.energy_score import draw_moments
from vpsci_ros.learning.imitation import OBSERVED, RecordedSteps, recorded
from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.actor import Actor, previous
from vpsci_ros.policy.planners import HORIZON, DenseGoals, DenseTNT, MultiPath, Planner
from vpsci_ros.policy.social_lstm import SocialLSTM
from vpsci_ros.world.observation import AGENTS, STEP

_STEP_FACTOR = 10.0  # the networks begin from nothing, as the heads of the others, whose steps are larger by this


def mixture_nll(logits: Tensor, mean: Tensor, log_sigma: Tensor, truth: Tensor) -> Tensor:
    """Return the mean over B of -log(p_k prod_t N(truth_t; mean_kt, sigma_kt)), k the plan whose mean is nearest.

    :param logits: [B, K]; mean, log_sigma: [B, K, T, 2] [m]; truth: [B, T, 2] [m].
    """
    apart = truth[:, None] - mean
    k = apart.norm(dim=3).mean(dim=2).argmin(dim=1)
    rows = torch.arange(len(k))
    log_sigma = log_sigma[rows, k]
    squared = (apart[rows, k] / log_sigma.exp()) ** 2
    density = (0.5 * squared + log_sigma + 0.5 * math.log(2.0 * math.pi)).sum(dim=(1, 2))
    return (density - functional.log_softmax(logits, dim=1)[rows, k]).mean()


def bivariate_nll(mean: Tensor, sigma: Tensor, rho: Tensor, truth: Tensor) -> Tensor:
    """Return -log N(truth), [...], of bivariate normals: mean, sigma [..., 2], correlation rho [...]."""
    z = (truth - mean) / sigma
    free = 1.0 - rho * rho
    square = (z[..., 0] ** 2 + z[..., 1] ** 2 - 2.0 * rho * z[..., 0] * z[..., 1]) / free
    return 0.5 * square + sigma.log().sum(dim=-1) + 0.5 * free.log() + math.log(2.0 * math.pi)


def ways(agent: str, actions: Tensor, start: Scene, recorded_actions: Tensor) -> Tensor:
    """Return where K plans of an agent lead, [M, K, T, 2] [m], from its place and in the frame of the start.

    :param actions: [M, K, T, 2] [m/s2]; recorded_actions: [M, T, 2], what the other agent does meanwhile.
    """
    count, plans, steps = actions.shape[:3]
    scene = Scene(*(part.repeat_interleave(plans, dim=0) for part in start))
    begin, out = scene, []
    other = AGENTS[1 - AGENTS.index(agent)]
    for step in range(steps):
        mine = actions[:, :, step].flatten(0, 1)
        theirs = recorded_actions[:, step].repeat_interleave(plans, dim=0)
        scene = advance(scene, {agent: mine, other: theirs})
        out.append(to_heading_frame(getattr(scene, agent) - getattr(begin, agent), begin.heading))
    return torch.stack(out, dim=1).unflatten(0, (count, plans))


class Prediction:
    """Both predictors, their optimiser, and the near misses that they learn from.

    :raises InvalidInput: an actor that is none of the three, or no near miss has 3 s after some step.
    """

    def __init__(self, networks: Networks, interactions: Interactions, config: PretrainConfig) -> None:
        self._networks, self._interactions, self._config = networks, interactions, config.imitation
        for agent in AGENTS:
            if not isinstance(networks.actor[agent], (Planner, SocialLSTM)):
                raise InvalidInput(f"encoder {networks.config.encoder}: a predictor's loss needs a predictor's network")
        groups = [
            {"params": [p for p in networks.actor.parameters() if (p.ndim == 2) == matrices], "weight_decay": decay}
            | {"factor": _STEP_FACTOR}
            for matrices, decay in ((True, WEIGHT_DECAY / _STEP_FACTOR), (False, 0.0))
        ]
        self._descent = Descent(networks.actor, groups, config)

    def update(self, rng: np.random.Generator, iteration: int) -> dict[str, float]:
        """Take one step, and return the losses by name."""
        config = self._config
        start = draw_moments(self._interactions, config.rollouts, HORIZON, config.mirror, rng)
        data = recorded(self._interactions, start, OBSERVED + HORIZON + 1)
        lead = start.at - start.begin
        losses = {agent: self._loss(agent, self._networks.actor[agent], data, lead) for agent in AGENTS}
        norm = self._descent.step(torch.stack([*losses.values()]).sum(), iteration)
        named = {f"{agent}_prediction_loss": float(loss.detach()) for agent, loss in losses.items()}
        return named | {"imitation_gradient_norm": norm}

    def _loss(self, agent: str, actor: Actor, data: RecordedSteps, lead: NDArray[np.int64]) -> Tensor:
        rows, at = torch.arange(len(lead)), torch.from_numpy(lead)
        done = data.action[agent]
        seen = data.observation[agent], previous(done), data.curvttc
        if isinstance(actor, SocialLSTM):
            acted = data.present[:, 1:]
            normal = actor.normal(actor.encoder(*(part[:, :-1] for part in seen)))
            return (bivariate_nll(*normal, done[:, :-1]) * acted).sum() / acted.sum()
        tracks = actor.encoder(*(part[:, : OBSERVED + 1] for part in seen))[rows, at]
        begin = scene_at(data.motion, at, self._networks.config.tracked_steps)
        after = at[:, None] + torch.arange(HORIZON)
        truth = data.motion[rows[:, None], after + 1][..., slice(0, 2) if agent == "vehicle" else slice(5, 7)]
        place = getattr(begin, agent)[:, None]
        truth = to_heading_frame((truth - place).flatten(0, 1), begin.heading.repeat_interleave(HORIZON))
        truth = truth.unflatten(0, (-1, HORIZON))
        other = data.action[AGENTS[1 - AGENTS.index(agent)]][rows[:, None], after]
        if isinstance(actor, MultiPath):
            plans = actor.plans(tracks)
            return mixture_nll(plans.logits, ways(agent, plans.actions, begin, other), plans.log_sigma, truth) / HORIZON
        assert isinstance(actor, DenseTNT)
        assert isinstance(actor.head, DenseGoals)
        head, velocity = actor.head, getattr(begin, f"{agent}_velocity")
        beside = truth[:, -1] - to_heading_frame(velocity, begin.heading) * (HORIZON * STEP)
        nearest = torch.cdist(beside[:, None], head.goals[None].expand(len(beside), -1, -1))[:, 0].argmin(dim=1)
        ways_there = ways(agent, head.complete(tracks, beside[:, None]).clamp(-actor.limit, actor.limit), begin, other)
        way = functional.smooth_l1_loss(ways_there[:, 0], truth)
        return functional.cross_entropy(head.scores(tracks), nearest) + 10.0 * way
