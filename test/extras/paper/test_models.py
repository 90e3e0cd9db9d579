"""Table 9's networks: causal, and they act step by step as over the whole history, from a file of weights."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.models import FeedForwardLayer, LSTMLayer, TransformerLayer
from vpsci_ros.extras.paper.studies.networks import network_of
from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.models import make_actor
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.stepped import SteppedActor
from vpsci_ros.policy.weights import weights_from_bytes, weights_to_bytes

SMALL = NetworkConfig(hidden=16, heads=2, attention_window=4)
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


def weights(name, seed=0, network=SMALL):
    torch.manual_seed(seed)
    networks = Networks(network_of(name, network))
    with torch.no_grad():
        for parameter in networks.actor["vehicle"].parameters():
            parameter.add_(0.2 * torch.randn_like(parameter))
    return networks.weights({}, {})


def histories(rows=4, steps=7):
    rng = np.random.default_rng(1)
    seen = rng.normal(size=(rows, steps, 6)).astype(np.float32)
    done = rng.normal(size=(rows, steps, 2)).astype(np.float32)
    return seen, done, rng.uniform(1.0, 6.0, (rows, steps))


@pytest.mark.parametrize("name", ["transformer", "lstm", "feedforward"])
def test_a_file_of_weights_acts_step_by_step_as_its_network_says_of_the_whole_history(name):
    made = weights_from_bytes(weights_to_bytes(weights(name)))
    seen, done, curvttc = histories()
    rows, steps = curvttc.shape
    actor, begins = SteppedActor(made.actor("vehicle"), rows), np.arange(rows) % 3  # some rows begin later
    answers, every = np.zeros_like(done), np.arange(rows)
    for step in range(steps + 2):
        at, active = np.clip(step - begins, 0, steps - 1), (step >= begins) & (step - begins < steps)
        said = actor.step(seen[every, at], curvttc[every, at], step == begins, active)
        actor.executed(done[every, at], active)
        answers[every[active], at[active]] = said[active]
    network = make_actor(made.network)
    network.load_state_dict({k: torch.from_numpy(v.copy()) for k, v in made.part("vehicle_actor").items()})
    before = torch.cat([torch.zeros(rows, 1, 2), torch.from_numpy(done[:, :-1])], dim=1)
    with torch.no_grad():
        whole = network(torch.from_numpy(seen), before, torch.from_numpy(curvttc)).numpy()
    assert np.abs(whole).max() > 0.01
    np.testing.assert_allclose(answers, whole, atol=1e-5)


def test_weights_of_another_shape_are_refused():
    actor = SteppedActor(weights("lstm").actor("vehicle"), 1)
    other = weights("lstm", network=replace(SMALL, hidden=32))
    with pytest.raises(InvalidInput, match=r"expected networks of .*hidden=16.*, got .*hidden=32"):
        actor.load(other.actor("vehicle"))
