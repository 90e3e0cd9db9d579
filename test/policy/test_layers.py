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


def streamed(layer, x, risks, memory):
    return torch.stack([layer.step(x[:, t], risks[:, t], memory) for t in range(x.shape[1])], dim=1)


@torch.no_grad()
def test_step_by_step_is_the_whole_history(layer):
    x, risks = inputs(steps=60)
    whole, none = layer(x, risks)
    assert none is None
    assert torch.allclose(streamed(layer, x, risks, layer.empty(3)), whole, atol=1e-5)


@torch.no_grad()
def test_what_is_remembered_after_some_steps_of_each_row_goes_on_as_the_whole_history(layer):
    x, risks = inputs()
    whole, _ = layer(x, risks)
    for taken in ([0, 3, 7], [5, 5, 5], [0, 0, 0]):
        _, memory = layer(x, risks, torch.tensor(taken))
        for row, begun in enumerate(taken):
            rest = layer(x, risks, torch.tensor(taken))[1]
            one = slice(row, row + 1)
            rest.parts = tuple(part[one] for part in rest.parts)
            assert torch.allclose(
                streamed(layer, x[one, begun:], risks[one, begun:], rest), whole[one, begun:], atol=1e-5
            )
        memory.keep(2)
        assert all(len(part) == 2 for part in memory.parts)


@torch.no_grad()
def test_an_output_knows_the_past_within_its_reach_and_never_the_future(layer):
    x, risks = inputs()
    whole, _ = layer(x, risks)
    x[:, 4] += 1.0
    changed = (layer(x, risks)[0] != whole).any(dim=2).all(dim=0)
    last = 4 + REACH.get(type(layer), 99)
    assert changed.tolist() == [4 <= t < last for t in range(9)]


@torch.no_grad()
def test_a_cleared_row_begins_again_and_the_others_go_on(layer):
    x, risks = inputs()
    memory = layer.empty(3)
    streamed(layer, x, risks, memory)
    memory.clear(torch.tensor([True, False, False]))
    after, kept = streamed(layer, x, risks, memory), layer.empty(3)
    fresh = streamed(layer, x, risks, kept)
    assert torch.equal(after[0], fresh[0])
    if type(layer) is not FeedForwardLayer:
        assert not torch.equal(after[1], fresh[1])
