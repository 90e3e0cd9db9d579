import json

import numpy as np
import pytest
from safetensors.numpy import save

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.training_config import PretrainConfig
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.shapes import weight_shapes
from vpsci_ros.policy.weights import Weights, load_weights, resolved, save_weights, weights_from_bytes, weights_to_bytes

SMALL = NetworkConfig(hidden=16, heads=2)


@pytest.mark.parametrize(
    "config",
    [SMALL, NetworkConfig(hidden=256, layers=2)],
    ids=["small", "table_8"],
)
def test_the_expected_tensors_are_those_that_the_networks_have(config):
    tensors = Networks(config).weights({}, {}).tensors
    assert {name: tensor.shape for name, tensor in tensors.items()} == weight_shapes(config)


def test_a_file_keeps_tensors_configuration_and_facts(networks, tmp_path):
    weights = networks().weights(resolved(PretrainConfig(episodes=7)), {"stage": "pretrained", "data": {"steps": 3}})
    save_weights(tmp_path / "w.safetensors", weights)
    loaded = load_weights(tmp_path / "w.safetensors")
    assert loaded.network == SMALL
    assert loaded.configuration["PretrainConfig"]["episodes"] == 7
    assert loaded.facts["data"] == {"steps": 3}
    assert loaded.facts["software"]["vpsci_ros"]
    for name, tensor in weights.tensors.items():
        assert np.array_equal(loaded.tensors[name], tensor)


def test_equal_weights_give_equal_bytes(networks):
    weights = networks().weights({"a": {"b": 1}}, {name: {"é": name} for name in ("one", "two", "three", "four")})
    assert len({weights_to_bytes(weights) for _ in range(8)}) == 1
    assert weights_from_bytes(weights_to_bytes(weights)).facts["two"] == {"é": "two"}


@pytest.mark.parametrize("heads", [0, "", None])
def test_a_configuration_without_heads_is_refused(networks, heads):
    data = weights_to_bytes(networks().weights({}, {}))
    header = int.from_bytes(data[:8], "little")
    facts = json.loads(data[8 : 8 + header])
    configuration = json.loads(facts["__metadata__"]["configuration"])
    configuration["NetworkConfig"] |= {"heads": heads}
    facts["__metadata__"]["configuration"] = json.dumps(configuration)
    text = json.dumps(facts).encode()
    with pytest.raises(InvalidInput, match="configuration: heads"):
        weights_from_bytes(len(text).to_bytes(8, "little") + text + data[8 + header :])


def changed(networks, **tensors):
    weights = networks().weights({}, {})
    return Weights(weights.network, {k: v for k, v in (weights.tensors | tensors).items() if v is not None})


@pytest.mark.parametrize(
    ("tensor", "message"),
    [
        (np.zeros((3, 2), np.float32), r"vehicle_actor.head.4.bias: expected float32\[2\], got float32\[3, 2\]"),
        (np.zeros(2, np.float64), r"vehicle_actor.head.4.bias: expected float32\[2\], got float64\[2\]"),
        (np.full(2, np.nan, np.float32), "vehicle_actor.head.4.bias holds values that are not finite"),
        (None, "vehicle_actor.head.4.bias is missing"),
    ],
    ids=["shape", "type", "nan", "missing"],
)
def test_a_tensor_that_does_not_fit_is_named(networks, tensor, message):
    with pytest.raises(InvalidInput, match=message):
        weights_to_bytes(changed(networks, **{"vehicle_actor.head.4.bias": tensor}))


def test_tensors_are_checked_against_the_configuration_in_the_file(networks):
    data = weights_to_bytes(networks().weights({}, {}))
    other = data.replace(b'\\"hidden\\": 16', b'\\"hidden\\": 32')
    assert len(other) == len(data)
    assert other != data
    with pytest.raises(InvalidInput, match=r"expected float32\[32, 6\], got float32\[16, 6\]"):
        weights_from_bytes(other)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "expected a safetensors file"),
        (b"PK\x03\x04 a zip file, as torch.save writes", "expected a safetensors file"),
        (save({"a": np.zeros(1, np.float32)}), "expected format"),
    ],
    ids=["empty", "zip", "other"],
)
def test_other_files_are_refused(tmp_path, data, message):
    (tmp_path / "w.safetensors").write_bytes(data)
    with pytest.raises(InvalidInput, match=message) as error:
        load_weights(tmp_path / "w.safetensors")
    assert "w.safetensors" in str(error.value)
