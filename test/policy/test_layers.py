import numpy as np
import pytest
import torch

from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.layers import FeedForwardLayer, LSTMLayer, TransformerLayer

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, attention_window=4)
LAYERS = (FeedForwardLayer, LSTMLayer, TransformerLayer)
REACH = {FeedForwardLayer: 1, TransformerLayer: 4}  # steps that an output depends on


@pytest.fixture(params=LAYERS)
def layer(request):
    torch.manual_seed(1)
    made = request.param(SMALL)
    with torch.no_grad():
        for parameter in made.parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))  # so that no bias is at its zero
    return made


def inputs(steps=9, rows=3, seed=0):
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.normal(size=(rows, steps, 16)).astype(np.float32)), torch.rand(rows, steps)


@torch.no_grad()
def test_an_output_knows_the_past_within_its_reach_and_never_the_future(layer):
    x, risks = inputs()
    whole = layer(x, risks)
    x[:, 4] += 1.0
    changed = (layer(x, risks) != whole).any(dim=2).all(dim=0)
    last = 4 + REACH.get(type(layer), 99)
    assert changed.tolist() == [4 <= t < last for t in range(9)]
