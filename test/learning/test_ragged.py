"""Histories of different length are encoded as if each were alone, and little of the padding is."""

import torch

from vpsci_ros.learning.ragged import by_length
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.sst import SSTEncoder

LENGTH = torch.tensor([3, 40, 9, 1, 38, 20])
STEPS = 42  # two more than the longest, as where another tensor of the batch has more


def inputs():
    shapes = [(6,), (2,), ()]
    generator = torch.Generator().manual_seed(1)
    return [torch.randn(len(LENGTH), STEPS, *shape, generator=generator) for shape in shapes]


def encoder():
    torch.manual_seed(1)
    return SSTEncoder(NetworkConfig(hidden=32, heads=2))


def test_every_step_of_a_history_is_what_the_whole_batch_gives_and_zero_past_its_end():
    network, values = encoder(), inputs()
    found, whole = by_length(network, values, LENGTH), network(*values)
    inside = torch.arange(STEPS) < LENGTH[:, None]
    assert found.shape == whole.shape
    torch.testing.assert_close(found[inside], whole[inside])
    assert not found[~inside].any()


def test_gradients_are_those_of_the_whole_batch():
    network, values = encoder(), inputs()
    inside = (torch.arange(STEPS) < LENGTH[:, None])[..., None]
    wanted = torch.autograd.grad((network(*values) * inside).square().sum(), network.observation.weight)
    found = torch.autograd.grad(by_length(network, values, LENGTH).square().sum(), network.observation.weight)
    torch.testing.assert_close(found, wanted, rtol=1e-4, atol=1e-4)


def test_of_a_batch_that_is_half_padding_few_padded_steps_are_encoded():
    encoded = []

    def counting(values):
        encoded.append(values.shape[0] * values.shape[1])
        return values

    by_length(counting, inputs()[:1], LENGTH)
    # 40, 38 together (longer than half of 40), then 20, then 9, then 3, then 1
    assert encoded == [80, 20, 9, 3, 1]
