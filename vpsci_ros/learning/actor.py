"""The actor: an SST encoder and two hidden layers on top, to two accelerations (Table 8)."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from vpsci_ros.learning.config import ACTION_SIZE, NetworkConfig
from vpsci_ros.learning.sst import SSTEncoder, StepState

OUTPUT_INIT = 3e-3  # bound of the last layer's initial weights, so that an untrained actor keeps its velocity


class Actor(nn.Module):
    """mu(H(t)): history of one agent -> (longitudinal, lateral) acceleration [m/s2] in the vehicle's heading frame."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.limit = config.action_limit
        self.dropout = 0.0  # share of the encoded history and of the first hidden layer left out, while imitating
        self.encoder = SSTEncoder(config)
        first, second = config.actor_hidden
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

    def forward(self, observation: Tensor, action_before: Tensor, curvttc: Tensor) -> Tensor:
        """Return float32[B, T, 2]: the action at every step of histories as in `SSTEncoder.forward`, clipped."""
        return self._answer(self.encoder(observation, action_before, curvttc))

    def remember(
        self, observation: Tensor, action_before: Tensor, curvttc: Tensor, taken: Tensor
    ) -> tuple[Tensor, list[StepState]]:
        """Return `forward`'s actions, and the states of the histories' first `taken` steps for `step` to go on from."""
        encoded, states = self.encoder.remember(observation, action_before, curvttc, taken)
        return self._answer(encoded), states

    def step(self, observation: Tensor, action_before: Tensor, curvttc: Tensor, states: list[StepState]) -> Tensor:
        """Return float32[B, 2] for one more step with carried state, as in `SSTEncoder.step`, clipped."""
        return self._answer(self.encoder.step(observation, action_before, curvttc, states))

    def _answer(self, encoded: Tensor) -> Tensor:
        first, bent, second, bent_again, last = self.head
        x = bent(first(self._thinned(encoded)))
        action: Tensor = last(bent_again(second(self._thinned(x))))
        return action.clamp(-self.limit, self.limit)

    def _thinned(self, x: Tensor) -> Tensor:
        return functional.dropout(x, self.dropout) if self.dropout > 0.0 else x

    def empty_history(self) -> list[StepState]:
        """Return the state of an empty history."""
        return [StepState() for _ in self.encoder.layers]


def previous(actions: Tensor) -> Tensor:
    """Shift executed actions float32[B, T, 2] by one step, so that entry t is the action before step t (zero at 0)."""
    return torch.cat([torch.zeros_like(actions[:, :1]), actions[:, :-1]], dim=1)
