"""The actor: an encoder of the history and two hidden layers on top, to two accelerations (Table 8)."""

from typing import Any, cast

import torch
from torch import Tensor, nn

from vpsci_ros.policy.config import ACTOR_HIDDEN, NetworkConfig
from vpsci_ros.policy.sst import EncoderLayer, SSTEncoder, SSTLayer
from vpsci_ros.world.observation import ACTION_SIZE

OUTPUT_INIT = 3e-3  # bound of the last layer's initial weights, so that an untrained actor keeps its velocity


class InwardClamp(torch.autograd.Function):
    """Clamp to [-limit, limit]; beyond the limit, a gradient that leads back inside still passes.

    An output that a plain clamp has cut would get no gradient, and stay beyond the limit for good. After 'inverting
    gradients' in 'Deep reinforcement learning in parameterized action space' by Hausknecht and Stone 2016
    (https://arxiv.org/abs/1511.04143).
    """

    @staticmethod
    def forward(ctx: Any, out: Tensor, limit: float) -> Tensor:
        """Return the clamped output of the network."""
        ctx.save_for_backward(out)
        ctx.limit = limit
        return out.clamp(-limit, limit)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        """Return the gradient, without its part that would move a clamped output further outward.

        Descent moves an output against its gradient: inward where both have the same sign.
        """
        (out,) = ctx.saved_tensors
        return gradient * ((out.abs() <= ctx.limit) | (gradient * out > 0)), None


class Actor(nn.Module):
    """mu(H(t)): history of one agent -> (longitudinal, lateral) acceleration [m/s2] in the vehicle's heading frame."""

    def __init__(self, config: NetworkConfig, layer: type[EncoderLayer] = SSTLayer) -> None:
        super().__init__()
        self.limit = config.action_limit
        self.encoder = SSTEncoder(config, layer)
        first, second = ACTOR_HIDDEN
        self.head = nn.Sequential(
            nn.Linear(config.hidden, first),
            nn.ReLU(),
            nn.Linear(first, second),
            nn.ReLU(),
            nn.Linear(second, ACTION_SIZE),
        )
        last = self.head[-1]
        assert isinstance(last, nn.Linear)
        nn.init.uniform_(last.weight, -OUTPUT_INIT, OUTPUT_INIT)
        nn.init.zeros_(last.bias)

    def forward(
        self, observation: Tensor, action_before: Tensor, curvttc: Tensor, step: Tensor | None = None
    ) -> Tensor:
        """Return float32[B, T, 2]: the action at every step of histories as in `SSTEncoder.forward`, clipped.

        With `step` float32[B, 1, 2]: the action at that step alone.
        """
        out: Tensor = self.head(self.encoder(observation, action_before, curvttc, step))
        clamped: Tensor = InwardClamp.apply(out, self.limit)  # type: ignore[no-untyped-call]
        return clamped


class Actors(nn.ModuleDict):
    """An actor for each agent."""

    def __getitem__(self, key: str) -> Actor:
        """Return the actor of "vehicle" or "pedestrian"."""
        return cast(Actor, super().__getitem__(key))


def previous(actions: Tensor) -> Tensor:
    """Shift executed actions float32[B, T, 2] by one step, so that entry t is the action before step t (zero at 0)."""
    return torch.cat([torch.zeros_like(actions[:, :1]), actions[:, :-1]], dim=1)
