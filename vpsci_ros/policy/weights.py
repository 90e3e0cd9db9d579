"""Weights of all networks in one safetensors file, checked tensor by tensor against the configuration it carries.

A file holds both actors and both critics in float32, the normalisation of observations and the speed statistics of
rewards (14)-(15). Target networks are not stored: training from a weights file starts them equal to the networks, as
Algorithm 1 does. The file's metadata are text: `format`, `tensors_sha256` (`Weights.digest`, against damage), `stage`,
`configuration` (JSON of every resolved parameter), `software`, `data` and `held_out` (JSON). For networks with SST
layers nothing here needs torch, and no pickle is ever read.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import build, values_of
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.shapes import weight_shapes
from vpsci_ros.policy.tensor_file import Tensors, digest_of, read_bytes, read_tensors, tensors_to_bytes
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.world.observation import AGENTS

FORMAT = "vpsci-ma-sst-ddpg 2"


@dataclass(frozen=True)
class Weights:
    """Everything that a weights file holds.

    :ivar network: shape of the networks.
    :ivar tensors: float32 arrays, named as in `vpsci_ros.policy.shapes.weight_shapes`.
    :ivar configuration: every resolved parameter of the run that made the weights, by configuration class.
    :ivar facts: further facts, JSON values: `stage`, `data`, `held_out`, `software`.
    """

    network: NetworkConfig
    tensors: Tensors
    configuration: dict[str, dict[str, Any]] = dataclasses.field(default_factory=dict)
    facts: dict[str, Any] = dataclasses.field(default_factory=dict)

    def part(self, name: str) -> Tensors:
        """Return the tensors of one part ("vehicle_actor", "pedestrian_critic", ...) without its name in front."""
        prefix = f"{name}."
        return {key.removeprefix(prefix): value for key, value in self.tensors.items() if key.startswith(prefix)}

    def actor(self, agent: str) -> "Weights":
        """Return the actor of "vehicle" or "pedestrian", tensors named as in `vpsci_ros.policy.shapes.actor_shapes`.

        :raises InvalidInput: another name.
        """
        if agent not in AGENTS:
            raise InvalidInput(f"agent: expected one of {', '.join(AGENTS)}, got {agent!r}")
        return Weights(self.network, self.part(f"{agent}_actor"))

    def digest(self) -> str:
        """Return the SHA-256 of names and values of all tensors, as hexadecimal digits; facts do not enter."""
        return digest_of(self.tensors)


def weights_to_bytes(weights: Weights) -> bytes:
    """Return the bytes of a safetensors file, as for a `PolicyWeights` message; equal weights give equal bytes.

    :raises InvalidInput: a tensor is missing, unknown, of the wrong shape or type, or not finite.
    """
    _check(weights.tensors, weights.network, "weights")
    configuration = weights.configuration | {"NetworkConfig": dataclasses.asdict(weights.network)}
    return tensors_to_bytes(weights.tensors, FORMAT, {**weights.facts, "configuration": configuration})


def weights_from_bytes(data: bytes, where: str = "weights") -> Weights:
    """Return the weights in the bytes of a safetensors file; `where` opens the error messages.

    :raises InvalidInput: not a safetensors file of this format, or its tensors do not fit its own configuration.
    """
    tensors, facts = read_tensors(data, FORMAT, where, "give a file that `vpsci pretrain` or `vpsci refine` wrote")
    configuration = facts.pop("configuration", None)
    if not isinstance(configuration, dict) or not isinstance(configuration.get("NetworkConfig"), dict):
        raise InvalidInput(f"{where}: damaged weights file: no configuration in the metadata; copy or train it again")
    network = build(NetworkConfig, configuration["NetworkConfig"], f"{where}, configuration")
    _check(tensors, network, where)
    return Weights(network, tensors, configuration, facts)


def save_weights(path: str | Path, weights: Weights) -> None:
    """Write a weights file, whole or not at all.

    :raises InvalidInput: as `weights_to_bytes`, or the folder does not exist.
    """
    data = weights_to_bytes(weights)
    with atomic_write(path) as temporary:
        temporary.write_bytes(data)


def load_weights(path: str | Path) -> Weights:
    """Read a weights file.

    :raises InvalidInput: no such file, or as `weights_from_bytes`.
    """
    return weights_from_bytes(read_bytes(path, "weights: train them with `vpsci pretrain`"), str(path))


def resolved(*configs: Any) -> dict[str, dict[str, Any]]:
    """Return the values of configuration objects, as JSON values by class name, for `Weights.configuration`."""
    return {type(c).__name__: values_of(c) for c in configs}


def _check(tensors: Mapping[str, NDArray[Any]], network: NetworkConfig, where: str) -> None:
    expected = weight_shapes(network)
    for name, shape in expected.items():
        if name not in tensors:
            raise InvalidInput(f"{where}: tensor {name} is missing; expected float32{list(shape)}")
        tensor = tensors[name]
        if tensor.dtype != np.float32 or tensor.shape != shape:
            raise InvalidInput(
                f"{where}: tensor {name}: expected float32{list(shape)}, got {tensor.dtype}{list(tensor.shape)}"
            )
        if not np.isfinite(tensor).all():
            raise InvalidInput(f"{where}: tensor {name} holds values that are not finite; train again")
    for name in tensors:
        if name not in expected:
            raise InvalidInput(f"{where}: unknown tensor {name}; the configuration in the metadata does not have it")
