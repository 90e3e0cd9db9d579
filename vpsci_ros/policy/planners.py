"""Predictors that say the next three seconds at once, as several plans with probabilities: MultiPath++ and DenseTNT.

A plan is accelerations at 30 steps, which MultiPath++ calls the control-based representation. Both take in an agent's
own track and the other's, relative to it, by one LSTM each; the recordings have no map, so that what their papers take
from lanes has nothing to stand on here. The plan of a step is followed for `HOLD` steps, or until something else was
executed than it says (a recorded action, in the steps that are observed), and then made again.

Drawn are the plan, by its probability, once an episode, and with it how far its way deviates, once a plan: MultiPath++
learns a deviation of the place at every step, and says nothing of how the steps belong together, so one number an axis
scales those of all steps. DenseTNT has no deviations beside its goals.
"""

import itertools
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from vpsci_ros.policy.actor import Actor
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.layers import LayerMemory, LSTMLayer
from vpsci_ros.policy.sst import NORMALISED_LIMIT, StepState, risk
from vpsci_ros.world.observation import ACTION_SIZE, OBSERVATION_SIZE, STEP

HORIZON = 30  # steps of a plan, 3 s
HOLD = 10  # steps that a plan is followed
PLANS = 6  # of each agent
LEAST_LOG_SIGMA = -4.0  # [log m]
_SAME = 1e-4  # [m/s2] two actions that differ by less are the same


class Plans(NamedTuple):
    """K plans of each of B agents.

    :ivar logits: [B, K] logarithms of their probabilities, up to a constant.
    :ivar actions: [B, K, 30, 2] [m/s2], in the vehicle's heading frame of each step.
    :ivar log_sigma: [B, K, 30, 2] logarithm of the deviation [m] of each step's position; -inf: none.
    """

    logits: Tensor
    actions: Tensor
    log_sigma: Tensor


class Tracks(nn.Module):
    """Both tracks as an agent sees them, by an LSTM each: [B, T, 2, hidden] of its own and of the other's."""

    observation_mean: Tensor
    observation_scale: Tensor

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.register_buffer("observation_mean", torch.zeros(OBSERVATION_SIZE))
        self.register_buffer("observation_scale", torch.ones(OBSERVATION_SIZE))
        self.own, self.other = nn.Linear(2 + ACTION_SIZE, config.hidden), nn.Linear(5, config.hidden)
        self.layers = nn.ModuleList([LSTMLayer(config), LSTMLayer(config)])

    def embed(self, observation: Tensor, action_before: Tensor, curvttc: Tensor) -> tuple[Tensor, Tensor]:
        """Return what both LSTMs take in, [..., hidden] each."""
        seen = ((observation - self.observation_mean) / self.observation_scale).clamp(
            -NORMALISED_LIMIT, NORMALISED_LIMIT
        )
        own = torch.cat([seen[..., :2], action_before], dim=-1)
        other = torch.cat([seen[..., 2:], risk(curvttc)[..., None]], dim=-1)
        return torch.relu(self.own(own)), torch.relu(self.other(other))

    def remember(
        self, observation: Tensor, action_before: Tensor, curvttc: Tensor, taken: Tensor
    ) -> tuple[Tensor, list[StepState]]:
        """See `SSTEncoder.remember`; [B, T, 2, hidden]."""
        inputs, risks, out, states = self.embed(observation, action_before, curvttc), risk(curvttc), [], []
        for layer, x in zip(self.layers, inputs, strict=True):
            y, state = layer(x, risks, taken)
            out.append(y)
            states.append(state)
        return torch.stack(out, dim=2), states

    def forward(self, observation: Tensor, action_before: Tensor, curvttc: Tensor) -> Tensor:
        """See `SSTEncoder.forward`; [B, T, 2, hidden]."""
        return self.remember(observation, action_before, curvttc, torch.zeros(len(observation), dtype=torch.long))[0]

    def step(self, observation: Tensor, action_before: Tensor, curvttc: Tensor, states: list[StepState]) -> Tensor:
        """See `SSTEncoder.step`; [B, 2, hidden]."""
        inputs, risks = self.embed(observation, action_before, curvttc), risk(curvttc)
        out = []
        for layer, x, state in zip(self.layers, inputs, states, strict=True):
            assert isinstance(layer, LSTMLayer)
            out.append(layer.step(x, risks, state))
        return torch.stack(out, dim=1)


class Planner(Actor):
    """An actor whose head, of both tracks [B, 2, hidden], makes `Plans`; z of `NetworkConfig.latent` picks the plan."""

    def __init__(self, config: NetworkConfig, head: nn.Module) -> None:
        nn.Module.__init__(self)
        self.limit, self.latent, self.dropout = config.action_limit, config.latent, 0.0
        self.encoder, self.head = Tracks(config), head  # type: ignore[assignment]

    def plans(self, tracks: Tensor) -> Plans:
        """Return what the head says of both tracks [B, 2, hidden], clipped."""
        plans: Plans = self.head(tracks)
        return plans._replace(actions=plans.actions.clamp(-self.limit, self.limit))

    def forward(self, observation: Tensor, action_before: Tensor, curvttc: Tensor) -> Tensor:
        """Return float32[B, T, 2], the first action of the likeliest plan of every step."""
        tracks = self.encoder(observation, action_before, curvttc)
        plans = self.plans(tracks.flatten(0, 1))
        return chosen(plans, None)[:, 0].view(*observation.shape[:2], ACTION_SIZE)

    def remember(
        self, observation: Tensor, action_before: Tensor, curvttc: Tensor, taken: Tensor
    ) -> tuple[Tensor, list[StepState]]:
        """See `Actor.remember`."""
        _, states = self.encoder.remember(observation, action_before, curvttc, taken)
        return self.forward(observation, action_before, curvttc), [*states, self._no_plan(len(observation))]

    def memory(self, rows: int) -> list[LayerMemory]:
        """See `Actor.memory`."""
        return [*super().memory(rows), self._no_plan(rows)]

    def step(self, observation: Tensor, action_before: Tensor, curvttc: Tensor, states: list[StepState]) -> Tensor:
        """Return float32[B, 2], by the likeliest plan."""
        return self.draw(observation, action_before, curvttc, states, None)

    def draw(
        self,
        observation: Tensor,
        action_before: Tensor,
        curvttc: Tensor,
        states: list[StepState],
        latent: Tensor | None,
        noise: Tensor | None = None,
    ) -> Tensor:
        """See `Actor.draw`: the plan that `latent` picks, and the deviation of `noise` when it is made."""
        *tracks, memory = states
        assert isinstance(memory, LayerMemory)
        plan, age, rows = *memory.parts, torch.arange(len(observation))
        at = age[:, 0].long()
        said = plan[rows, (at - 1).clamp(min=0)]
        follows = (at > 0) & (at < HOLD) & ((said - action_before).abs().amax(dim=1) < _SAME)
        seen = self.encoder.step(observation, action_before, curvttc, tracks)
        if not bool(follows.all()):
            drawn = (None if part is None else part[~follows] for part in (latent, noise))
            made = chosen(self.plans(seen[~follows]), *drawn).clamp(-self.limit, self.limit)
            plan = plan.index_put((rows[~follows],), made)
        at = torch.where(follows, at, 0)
        memory.parts = plan, (at + 1)[:, None].to(torch.float32)
        out: Tensor = plan[rows, at]
        return out

    def _no_plan(self, rows: int) -> LayerMemory:
        return LayerMemory(torch.zeros(rows, HORIZON, ACTION_SIZE), torch.zeros(rows, 1))


def chosen(plans: Plans, latent: Tensor | None, noise: Tensor | None = None) -> Tensor:
    """Return one plan of each, [B, 30, 2] [m/s2]: the likeliest, or one drawn by the standard normal `latent` [B, 1].

    :param noise: standard normal [B, 2]; every place of the plan deviates by so many of its own deviations, as nearly
        as a constant acceleration can do it (least squares over the steps). None: the mean.
    """
    if latent is None:
        k = plans.logits.argmax(dim=1)
    else:
        reached = torch.softmax(plans.logits, dim=1).cumsum(dim=1)
        k = (reached < torch.special.ndtr(latent)).sum(dim=1).clamp(max=plans.logits.shape[1] - 1)
    rows = torch.arange(len(k))
    actions = plans.actions[rows, k]
    if noise is None:
        return actions
    way = 0.5 * (STEP * torch.arange(1, HORIZON + 1)) ** 2  # [m], of an acceleration of 1 m/s2
    sigma = torch.einsum("t,btc->bc", way / way.square().sum(), plans.log_sigma[rows, k].exp())  # [m/s2]
    return actions + (noise * sigma)[:, None]


def _mlp(*widths: int) -> nn.Sequential:
    parts: list[nn.Module] = []
    for before, after in itertools.pairwise(widths):
        parts += [nn.Linear(before, after), nn.ReLU()]
    return nn.Sequential(*parts[:-1])


class ContextGating(nn.Module):
    """Multi-context gating of MultiPath++: every element and the context gate each other; their mean is the context.

    Its result does not depend on the order of the elements.
    """

    def __init__(self, width: int, blocks: int = 2) -> None:
        super().__init__()
        self.elements = nn.ModuleList(_mlp(width, width) for _ in range(blocks))
        self.contexts = nn.ModuleList(_mlp(width, width) for _ in range(blocks))
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(blocks))

    def forward(self, elements: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """Return both after all blocks: elements [B, n, width] and context [B, width]; each block has a skip."""
        for element, gate, norm in zip(self.elements, self.contexts, self.norms, strict=True):
            gated = torch.relu(element(elements)) * torch.relu(gate(context))[:, None]
            elements = norm(elements + gated)
            context = context + elements.mean(dim=1)
        return elements, context


class MultiPathHead(nn.Module):
    """Both tracks gate each other, then the learned anchors are gated by what came of it, and each makes a plan."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.anchors = nn.Parameter(torch.randn(PLANS, width) / width**0.5)
        self.tracks, self.decoder = ContextGating(width), ContextGating(width)
        self.out = _mlp(2 * width, width, 1 + 2 * HORIZON * ACTION_SIZE)

    def forward(self, tracks: Tensor) -> Plans:
        """Return the plans of tracks [B, 2, width]."""
        _, context = self.tracks(tracks, torch.ones_like(tracks[:, 0]))
        anchors, context = self.decoder(self.anchors.expand(len(tracks), -1, -1), context)
        out = self.out(torch.cat([anchors, context[:, None].expand_as(anchors)], dim=2))
        actions, log_sigma = out[..., 1:].unflatten(2, (2, HORIZON, ACTION_SIZE)).unbind(dim=2)
        return Plans(out[..., 0], actions, log_sigma.clamp(LEAST_LOG_SIGMA, 3.0))


class MultiPath(Planner):
    """MultiPath++ (Varadarajan et al. 2022, https://arxiv.org/abs/2111.14973): gating, learned anchors, a mixture."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config, MultiPathHead(config.hidden))


GOALS = (13, 9)  # forward and sideways
SPACING = 0.75  # [m] between goals
_NEAR = 1.5  # [m] goals nearer than this to a likelier one are left out at first
_ITERATIONS = 10  # of the optimisation of goals


class DenseGoals(nn.Module):
    """A dense grid of goals 3 s ahead, scored by attention to both tracks, and the way to a goal completed.

    The grid lies around where the agent's velocity leads, in the frame in which the plan begins: lanes, along which
    the original lays it, are not recorded. The goals of the plans are optimised on the scores, as in the original: from
    the likeliest ones that lie apart they move to where the expected squared distance to the nearest of them is least
    (Lloyd's iterations in place of hill climbing with random steps). The second network of the original learns to say
    what this optimisation finds, since it takes long on a dense map; on this grid it does not.
    """

    goals: Tensor

    def __init__(self, width: int) -> None:
        super().__init__()
        axes = [SPACING * (torch.arange(n) - (n - 1) / 2) for n in GOALS]
        self.register_buffer("goals", torch.cartesian_prod(*axes), persistent=False)
        self.goal, self.key, self.value = nn.Linear(2, width), nn.Linear(width, width), nn.Linear(width, width)
        self.score = _mlp(2 * width, width, 1)
        self.way = _mlp(3 * width + 2, width, HORIZON * ACTION_SIZE)

    def scores(self, tracks: Tensor) -> Tensor:
        """Return the logits of all goals, [B, G]."""
        query = self.goal(self.goals)
        share = torch.softmax(torch.einsum("gw,btw->bgt", query, self.key(tracks)) / query.shape[1] ** 0.5, dim=2)
        known = torch.cat([share @ self.value(tracks), query.expand(len(tracks), -1, -1)], dim=2)
        out: Tensor = self.score(torch.relu(known)).squeeze(2)
        return out

    def complete(self, tracks: Tensor, goals: Tensor) -> Tensor:
        """Return accelerations [B, n, 30, 2] that lead to `goals` [B, n, 2] [m], beside where the velocity leads.

        To a constant acceleration, which comes there, the network adds the rest.
        """
        known = tracks.flatten(1)[:, None].expand(-1, goals.shape[1], -1)
        beside = self.way(torch.cat([known, torch.relu(self.goal(goals)), goals], dim=2))
        steady = goals * (2.0 / (HORIZON * STEP) ** 2)
        out: Tensor = steady[:, :, None] + beside.unflatten(2, (HORIZON, ACTION_SIZE))
        return out

    def forward(self, tracks: Tensor) -> Plans:
        """Return the plans of tracks [B, 2, width]: those of the likeliest goals that lie apart."""
        goals, share = self.optimised(torch.softmax(self.scores(tracks), dim=1))
        actions = self.complete(tracks, goals)
        return Plans(share.clamp(min=1e-12).log(), actions, torch.full_like(actions, -torch.inf))

    def optimised(self, share: Tensor) -> tuple[Tensor, Tensor]:
        """Return the goals of the plans, [B, K, 2] [m], and the probability of what lies nearest to each, [B, K].

        :param share: probabilities of the grid's goals, [B, G].
        """
        near, left, picked = torch.cdist(self.goals, self.goals) < _NEAR, share, []
        for _ in range(PLANS):
            best = left.argmax(dim=1)
            picked.append(self.goals[best])
            left = left.masked_fill(near[best], -1.0)
        goals, grid = torch.stack(picked, dim=1), self.goals.expand(len(share), -1, -1)
        for _ in range(_ITERATIONS):
            own = functional.one_hot(torch.cdist(grid, goals).argmin(dim=2), PLANS) * share[..., None]
            mass = own.sum(dim=1)
            middle = torch.einsum("bgk,gc->bkc", own, self.goals) / mass.clamp(min=1e-12)[..., None]
            goals = torch.where((mass > 1e-12)[..., None], middle, goals)
        return goals, mass


class DenseTNT(Planner):
    """DenseTNT (Gu, Sun and Zhao 2021, https://arxiv.org/abs/2108.09640): a dense grid of goals, then the way."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config, DenseGoals(config.hidden))
