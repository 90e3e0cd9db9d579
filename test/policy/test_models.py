"""Every network may act: step by step as over the whole history, from a file of weights, and in the world."""

import dataclasses

import numpy as np
import pytest
import torch

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.models import MODELS, make_actor, network_of
from vpsci_ros.policy.stepped import SteppedActor
from vpsci_ros.policy.weights import weights_from_bytes, weights_to_bytes

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, actor_hidden=[8, 8], critic_hidden=[8, 8])
STEPPED = ("transformer", "lstm", "feedforward")


def weights(name, seed=0):
    torch.manual_seed(seed)
    networks = Networks(network_of(name, SMALL))
    with torch.no_grad():
        for parameter in networks.actor["vehicle"].parameters():
            parameter.add_(0.2 * torch.randn_like(parameter))
    return networks.weights({}, {})


def histories(rows=4, steps=7):
    rng = np.random.default_rng(1)
    seen = rng.normal(size=(rows, steps, 6)).astype(np.float32)
    done = rng.normal(size=(rows, steps, 2)).astype(np.float32)
    return seen, done, rng.uniform(1.0, 6.0, (rows, steps))


@pytest.mark.parametrize("name", STEPPED)
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


def test_an_encoder_that_nobody_knows_is_refused():
    with pytest.raises(InvalidInput, match="unknown network 'gpt'"):
        make_actor(dataclasses.replace(SMALL, encoder="gpt"))


def test_every_built_in_network_can_be_built_and_its_weights_kept():
    for name in MODELS.built_in:
        made = weights(name)
        assert weights_from_bytes(weights_to_bytes(made)).digest() == made.digest()
