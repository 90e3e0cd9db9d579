"""Checkpoints: the state from which a run resumes with the same result, an item of `runs.journal`.

A checkpoint is a tree of dictionaries, lists, tensors, arrays, numbers and text. Behind the seal its file is in the
safetensors format: the arrays, named by their path in the tree, and the rest as JSON. Tuples are read back as lists.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.numpy import load, save

from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.journal import read_item, write_item

FORMAT = b"vpsci-checkpoint 2"
_ARRAY, _TENSOR, _TREE = "__array__", "__tensor__", "__tree__"


def save_checkpoint(path: str | Path, tree: dict[str, Any]) -> None:
    """Write the state `tree` as a checkpoint; the earlier checkpoint stays until the new one is complete."""
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    arrays[_TREE] = np.frombuffer(json.dumps(_flatten(tree, "", arrays)).encode(), np.uint8)
    write_item(Path(path), FORMAT, save(arrays))


def load_checkpoint(path: str | Path) -> dict[str, Any]:
    """Return the tree of a checkpoint file.

    :raises InvalidInput: a file that is damaged or cannot be read, or not a checkpoint of this format.
    """
    if (data := read_item(Path(path), FORMAT)) is None:
        raise InvalidInput(f"{path}: damaged, or no checkpoint of this version; delete it to start again")
    arrays = load(bytes(data))
    tree: dict[str, Any] = _unflatten(json.loads(arrays.pop(_TREE).tobytes()), arrays)
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
