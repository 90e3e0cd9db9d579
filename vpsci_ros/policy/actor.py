"""The actor: an encoder of the history and two hidden layers on top, to two accelerations (Table 8)."""

from typing import Any, cast

import torch
from torch import Tensor, nn

from vpsci_ros.policy.policy_config import ACTOR_HIDDEN, NetworkConfig
from vpsci_ros.policy.sst import EncoderLayer, Memory, SSTEncoder, SSTLayer, entry
from vpsci_ros.world.observation import ACTION_SIZE

OUTPUT_INIT = 3e-3  # bound of the last layer's initial weights: an untrained network adds nothing


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
    """mu(H(t)): history of one agent -> (longitudinal, lateral) acceleration [m/s2] in the vehicle's heading frame.

    The network's output is added to the acceleration of the step before, of which the share `fading` goes on. So an
    untrained actor does what best predicts people without a network, and a network learns what they do beyond it.

    :param fading: 0 to 1; kept with the weights, not trained.
    """

    fading: Tensor

    def __init__(self, config: NetworkConfig, fading: float, layer: type[EncoderLayer] = SSTLayer) -> None:
        super().__init__()
        self.register_buffer("fading", torch.tensor([fading], dtype=torch.float32))
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
        before = action_before if step is None else entry(action_before, step)
        return self._clamped(self.head(self.encoder(observation, action_before, curvttc, step)), before)

    def next(self, observation: Tensor, action_before: Tensor, curvttc: Tensor, memory: Memory) -> Tensor:
        """Return the action at one more step of B histories, float32[B, 2]; parameters as of `SSTEncoder.next`."""
        return self._clamped(self.head(self.encoder.next(observation, action_before, curvttc, memory)), action_before)

    def _clamped(self, out: Tensor, action_before: Tensor) -> Tensor:
        clamped: Tensor = InwardClamp.apply(out + self.fading * action_before, self.limit)  # type: ignore[no-untyped-call]
        return clamped


class Actors(nn.ModuleDict):
    """An actor for each agent."""

    def __getitem__(self, key: str) -> Actor:
        """Return the actor of "vehicle" or "pedestrian"."""
        return cast(Actor, super().__getitem__(key))


def previous(actions: Tensor, came: Tensor) -> Tensor:
    """Return the action before each step, float32[B, T, 2]: `came`, float32[B, 2], then all but the last `actions`."""
    return torch.cat([came[:, None], actions[:, :-1]], dim=1)
