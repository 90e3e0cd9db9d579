"""Checkpoints: the state from which a run resumes with the same result, in one safetensors file.

A checkpoint is a tree of dictionaries, lists, tensors, arrays, numbers and text. Arrays become tensors of the file,
named by their path in the tree; the rest is JSON in the file's metadata. Tuples are read back as lists.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import atomic_write

FORMAT = "vpsci-checkpoint 1"
_ARRAY, _TENSOR = "__array__", "__tensor__"


def save_checkpoint(path: str | Path, tree: dict[str, Any]) -> None:
    """Write the state `tree` as a checkpoint; the earlier checkpoint stays until the new one is complete."""
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    skeleton = _flatten(tree, "", arrays)
    with atomic_write(path) as temporary:
        # save_file would write another file beside it first, which stays where the process is killed
        temporary.write_bytes(save(arrays, {"format": FORMAT, "tree": json.dumps(skeleton)}))


def load_checkpoint(path: str | Path) -> dict[str, Any]:
    """Return the tree of a checkpoint file.

    :raises InvalidInput: a file that cannot be read, or not a checkpoint of this format.
    """
    try:
        with safe_open(str(path), framework="np") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
    except (SafetensorError, OSError) as error:
        raise InvalidInput(f"{path}: cannot read as a checkpoint: {error}; delete it to start again") from error
    if metadata.get("format") != FORMAT or "tree" not in metadata:
        raise InvalidInput(f"{path}: expected {FORMAT!r}, got {metadata.get('format')!r}; delete it to start again")
    tree: dict[str, Any] = _unflatten(json.loads(metadata["tree"]), arrays)
    return tree


def _flatten(value: Any, name: str, arrays: dict[str, Any]) -> Any:
    if isinstance(value, torch.Tensor):
        arrays[name] = np.ascontiguousarray(value.detach().numpy())
        return {_TENSOR: name}
    if isinstance(value, np.ndarray):
        arrays[name] = np.ascontiguousarray(value)
        return {_ARRAY: name}
    if isinstance(value, dict):
        # Keys are kept with their type, since optimisers number their parameters.
        return {"__dict__": [[key, _flatten(item, f"{name}/{key}", arrays)] for key, item in value.items()]}
    if isinstance(value, (list, tuple)):
        return [_flatten(item, f"{name}/{i}", arrays) for i, item in enumerate(value)]
    return value


def _unflatten(value: Any, arrays: dict[str, Any]) -> Any:
    if isinstance(value, list):
        return [_unflatten(item, arrays) for item in value]
    if isinstance(value, dict):
        if _TENSOR in value:
            return torch.from_numpy(arrays[value[_TENSOR]].copy())
        if _ARRAY in value:
            return arrays[value[_ARRAY]]
        return {key: _unflatten(item, arrays) for key, item in value["__dict__"]}
    return value
