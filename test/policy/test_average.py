"""An average of trainings is the mean of their tensors, says of which, and refuses what does not belong together."""

import dataclasses

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.average import average
from vpsci_ros.policy.weights import Weights, weights_from_bytes, weights_to_bytes

FACTS = {"stage": "refined", "data": {"sha256": "00", "held_out_clips": []}}


@pytest.fixture
def trained(networks) -> list[Weights]:
    return [
        networks(seed=seed).weights({"Refine": {"steps": 80 + seed}, "Same": {"a": 1}}, FACTS | {"seed": seed})
        for seed in (1, 2)
    ]


def test_every_tensor_is_the_mean_and_survives_a_file(trained) -> None:
    made = weights_from_bytes(weights_to_bytes(average(trained)))
    for name, tensor in made.tensors.items():
        np.testing.assert_allclose(
            tensor, (trained[0].tensors[name] + trained[1].tensors[name]) / 2, rtol=1e-6, atol=1e-7
        )


def test_what_all_say_is_said_once_and_what_differs_of_each(trained) -> None:
    made = average(trained)
    assert made.facts["stage"] == "refined"
    assert "seed" not in made.facts
    assert [part["seed"] for part in made.facts["averaged"]] == [1, 2]
    assert [part["tensors_sha256"] for part in made.facts["averaged"]] == [own.digest() for own in trained]
    assert made.configuration["Same"] == {"a": 1}
    assert [part["configuration"]["Refine"] for part in made.facts["averaged"]] == [{"steps": 81}, {"steps": 82}]


def test_others_are_refused_by_what_differs(trained) -> None:
    with pytest.raises(InvalidInput, match="expected two or more, got 1"):
        average(trained[:1])
    other = dataclasses.replace(trained[1], facts=trained[1].facts | {"stage": "pretrained"})
    with pytest.raises(InvalidInput, match="stage of number 2: expected refined, as of the first, got pretrained"):
        average([trained[0], other])
