import pytest
import torch

from vpsci_ros.policy.actor import Actor, previous
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.sst import EncoderLayer, Memory, SSTLayer, risk

SMALL = NetworkConfig(hidden=16, heads=2)


def history(batch=2, steps=30):
    generator = torch.Generator().manual_seed(4)
    observation = torch.randn(batch, steps, 6, generator=generator)
    action = torch.randn(batch, steps, 2, generator=generator)
    return (
        observation,
        previous(action, torch.randn(batch, 2, generator=generator)),
        torch.rand(batch, steps, generator=generator) * 8.0,
    )


def test_risk_is_zero_from_five_seconds_on_and_one_on_contact():
    assert risk(torch.tensor([0.0, 2.5, 5.0, torch.inf])).tolist() == [1.0, 0.5, 0.0, 0.0]


def test_a_layer_is_the_recurrence_of_equation_3_and_the_attention_of_equation_4():
    """Written out step by step for one history, as the equations read."""
    torch.manual_seed(0)
    layer = SSTLayer(SMALL)
    x, risks = torch.randn(1, 14, 16), torch.rand(1, 14)
    a = torch.sigmoid(layer.decay_logit)
    h, states, expected = torch.zeros(16), [], []
    for t in range(14):
        h = a * h + torch.sqrt(1 - a * a) * (layer.input.weight @ x[0, t])
        states.append(h)
        y = layer.readout.weight @ h + layer.skip * x[0, t]
        context = []
        for head in range(2):
            part = slice(8 * head, 8 * head + 8)
            query = (layer.query.weight @ h)[part]
            window = range(max(0, t - 9), t + 1)
            logits = torch.stack(
                [
                    query @ (layer.key.weight @ states[i])[part] / 8**0.5 + layer.risk_gain[head] * risks[0, i]
                    for i in window
                ]
            )
            values = torch.stack([states[i][part] for i in window])
            context.append(torch.softmax(logits, 0) @ values)
        expected.append(layer.norm(x[0, t] + y + layer.attended.weight @ torch.cat(context)))
    torch.testing.assert_close(layer(x, risks)[0], torch.stack(expected), atol=1e-5, rtol=1e-4)


class Summed(EncoderLayer):
    """A layer without a memory of its own: the running sum."""

    def forward(self, x, risks):
        return x.cumsum(dim=1) * risks[..., None]


@pytest.mark.parametrize("layer", [SSTLayer, Summed])
def test_step_by_step_an_actor_says_what_it_says_of_the_whole_history_and_has_the_same_gradients(layer):
    torch.manual_seed(3)
    actor, (observation, before, curvttc) = Actor(SMALL, 0.9, layer), history(steps=25)
    torch.nn.init.normal_(actor.head[-1].weight)
    memory = Memory()
    steps = [actor.next(observation[:, t], before[:, t], curvttc[:, t], memory) for t in range(25)]
    stepped, whole = torch.stack(steps, dim=1), actor(observation, before, curvttc)
    torch.testing.assert_close(stepped, whole, atol=1e-5, rtol=1e-5)
    parameters = list(actor.parameters())
    found, expected = (torch.autograd.grad((out**2).sum(), parameters) for out in (stepped, whole))
    torch.testing.assert_close(found, expected, atol=1e-3, rtol=1e-3)


def test_an_untrained_actor_lets_the_acceleration_go_on_and_fade():
    actor, before = Actor(SMALL, 0.8), torch.tensor([[[2.0, -1.0]]])
    action = actor(torch.zeros(1, 1, 6), before, torch.ones(1, 1))
    torch.testing.assert_close(action, 0.8 * before, atol=0.05, rtol=0.0)


@pytest.fixture
def actor(networks):
    """A vehicle's actor."""
    return networks(SMALL).actor["vehicle"]


def test_the_future_does_not_matter(actor):
    observation, before, curvttc = history()
    changed = observation.clone()
    changed[:, 20:] += 1.0
    difference = (actor(observation, before, curvttc) - actor(changed, before, curvttc)).abs().amax(dim=(0, 2))
    assert difference[:20].max() == 0.0
    assert difference[20:].min() > 0.0
