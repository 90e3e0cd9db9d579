"""A gated recurrent unit (Cho et al. 2014) in place of the SST's layers."""

from torch import Tensor, nn

from vpsci_ros.policy.models import Model
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.sst import EncoderLayer


class GatedLayer(EncoderLayer):
    """LayerNorm(x + h_t) of a gated recurrent unit."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.cell = nn.GRU(config.hidden, config.hidden, batch_first=True)
        self.norm = nn.LayerNorm(config.hidden)

    def forward(self, x: Tensor, risks: Tensor) -> Tensor:
        """Return the output of every step."""
        return self.norm(x + self.cell(x)[0])


MA_GRU = Model(GatedLayer)  # or learning="ddpg": trained by the critics' policy gradient
