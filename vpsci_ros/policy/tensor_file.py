"""Tensors and metadata in one safetensors file, with deterministic bytes and a checksum.

The metadata are text: `format`, `tensors_sha256` (against damage), `software` and further facts, as JSON. No pickle is
ever read.
"""

import hashlib
import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from vpsci_ros.documents import parse_json, reason, require_regular
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.provenance import software_versions

CHECKSUM = "tensors_sha256"
Tensors = dict[str, NDArray[np.float32]]


def digest_of(tensors: Mapping[str, NDArray[Any]]) -> str:
    """Return the SHA-256 of names and values of all tensors, as hexadecimal digits."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(name.encode() + np.ascontiguousarray(tensors[name]).tobytes())
    return digest.hexdigest()


def tensors_to_bytes(tensors: Mapping[str, NDArray[Any]], form: str, facts: Mapping[str, Any]) -> bytes:
    """Return the bytes of a safetensors file; equal contents give equal bytes.

    :param form: name of the format; facts: JSON values.
    """
    known = {"software": software_versions(), **facts}
    metadata = {name: json.dumps(value, sort_keys=True) for name, value in known.items()}
    metadata |= {"format": form, CHECKSUM: digest_of(tensors)}
    return _in_order(save({name: np.ascontiguousarray(tensors[name]) for name in sorted(tensors)}, metadata))


def _in_order(data: bytes) -> bytes:
    """Return a safetensors file with its metadata in alphabetical order; the library writes it in a random one."""
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    header["__metadata__"] = dict(sorted(header["__metadata__"].items()))
    text = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 8)  # tensors are aligned to eight bytes
    return len(text).to_bytes(8, "little") + text + data[8 + length :]


def read_bytes(path: str | Path, what: str) -> bytes:
    """Return the bytes of a file.

    :param what: what the file is, and what to do if it is missing, for the message.
    :raises InvalidInput: no such file, no regular one, or one that cannot be read.
    """
    path = Path(path)
    require_regular(path)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InvalidInput(f"{path}: cannot read {what} ({error.strerror})") from error


def format_of(data: bytes, where: str) -> str:
    """Return the format named in a file's metadata, or the empty string.

    :raises InvalidInput: no safetensors file.
    """
    return _metadata(data, where).get("format", "")


def read_tensors(data: bytes, form: str, where: str, remedy: str) -> tuple[Tensors, dict[str, Any]]:
    """Return the tensors and facts in a file's bytes.

    :param form: name of the format that it has to be; remedy: what to do otherwise.
    :raises InvalidInput: not a safetensors file of this format, a tensor that is not of finite float32, or damage.
    """
    metadata = _metadata(data, where)
    if metadata.get("format") != form:
        raise InvalidInput(
            f"{where}: expected format {form!r} in the metadata, got {metadata.get('format')!r}; {remedy}"
        )
    header = parse_json(data[8 : 8 + int.from_bytes(data[:8], "little")], where)
    kinds = {str(each.get("dtype")) for each in header.values() if isinstance(each, dict)}
    if half := sorted(kinds & {"BF16", "F16"}):
        raise InvalidInput(f"{where}: expected tensors of F32, got {' and '.join(half)}; convert them to F32")
    try:
        tensors: Tensors = load(data)
        facts = {name: parse_json(text, where) for name, text in metadata.items() if name not in ("format", CHECKSUM)}
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise InvalidInput(f"{where}: damaged file: {reason(error)}; copy or make it again") from None
    for name, tensor in tensors.items():
        if tensor.dtype != np.float32:
            raise InvalidInput(f"{where}: tensor {name}: expected float32, got {tensor.dtype}")
        if not np.isfinite(tensor).all():
            raise InvalidInput(f"{where}: tensor {name} holds values that are not finite; make it again")
    if metadata.get(CHECKSUM) != digest_of(tensors):
        raise InvalidInput(f"{where}: damaged file: its tensors are not those it was written with; copy it again")
    return tensors, facts


def _metadata(data: bytes, where: str) -> dict[str, str]:
    """Return the metadata in the header of a safetensors file: 8 bytes of length, then JSON."""
    try:
        (length,) = struct.unpack_from("<Q", data)
        if length > len(data) - 8:
            raise ValueError(f"header of {length} bytes in a file of {len(data)}")
        metadata = parse_json(data[8 : 8 + length], where).get("__metadata__", {})
        if not isinstance(metadata, dict):
            raise ValueError("metadata are not a mapping")
    except (struct.error, ValueError, AttributeError) as error:
        raise InvalidInput(
            f"{where}: expected a safetensors file, got {len(data)} bytes of something else ({error})"
        ) from None
    return metadata
