"""The centralised critic: the agent's history on one branch, the joint action on the other (Table 8)."""

import torch
from torch import Tensor, nn

from vpsci_ros.policy.config import CRITIC_ACTION, CRITIC_HIDDEN, CRITIC_STATE, NetworkConfig
from vpsci_ros.policy.models import MODELS
from vpsci_ros.policy.sst import SSTEncoder
from vpsci_ros.world.observation import ACTION_SIZE


class Critic(nn.Module):
    """Q(H(t), A_own(t), A_other(t)) of one agent; it has an encoder of its own over that agent's history."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.encoder = SSTEncoder(config, MODELS.find(config.encoder).layer)
        self.state = nn.Linear(config.hidden, CRITIC_STATE)
        self.action = nn.Linear(2 * ACTION_SIZE, CRITIC_ACTION)
        first, second = CRITIC_HIDDEN
        self.head = nn.Sequential(
            nn.Linear(CRITIC_STATE + CRITIC_ACTION, first),
            nn.ReLU(),
            nn.Linear(first, second),
            nn.ReLU(),
            nn.Linear(second, 1),
        )

    @torch.no_grad()
    def scale_values(self, factor: float) -> None:
        """Make Q so many times what it is, for every history and action."""
        last = self.head[-1]
        assert isinstance(last, nn.Linear)
        last.weight.mul_(factor)
        last.bias.mul_(factor)

    def encode(self, observation: Tensor, action_before: Tensor, curvttc: Tensor, step: Tensor | None = None) -> Tensor:
        """Return the state branch, float32[B, T or 1, 16], of histories and steps as in `SSTEncoder.forward`."""
        return torch.relu(self.state(self.encoder(observation, action_before, curvttc, step)))

    def value(self, encoded: Tensor, own_action: Tensor, other_action: Tensor) -> Tensor:
        """Return Q, float32[...], of encoded histories [..., 16] and the joint action [..., 2] each, m/s2."""
        joint = torch.relu(self.action(torch.cat([own_action, other_action], dim=-1)))
        q: Tensor = self.head(torch.cat([encoded, joint], dim=-1))
        return q.squeeze(-1)
