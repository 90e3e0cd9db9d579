import pytest
import torch

from vpsci_ros.policy.actor import previous
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.sst import SSTLayer, risk

SMALL = NetworkConfig(hidden=16, heads=2)


def history(batch=2, steps=30):
    generator = torch.Generator().manual_seed(4)
    observation = torch.randn(batch, steps, 6, generator=generator)
    action = torch.randn(batch, steps, 2, generator=generator)
    return observation, previous(action), torch.rand(batch, steps, generator=generator) * 8.0


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
