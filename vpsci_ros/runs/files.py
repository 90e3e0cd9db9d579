"""Atomic file writes, empty output folders, and the hash of a file."""

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.documents import require_regular
from vpsci_ros.errors import InvalidInput

FAILURE = "failed.json"  # why a command left a folder unfinished


def sha256(path: str | Path) -> str:
    """Return the SHA-256 of a file's content as hexadecimal digits.

    :raises InvalidInput: it is a pipe or a device, which may never end.
    """
    require_regular(path)
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def changed_files(folder: Path, hashes: Mapping[str, str]) -> list[str]:
    """Return the names of the files in `hashes` that `folder` lacks or has with another SHA-256."""
    return [name for name, own in hashes.items() if not (folder / name).is_file() or sha256(folder / name) != own]


@contextlib.contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; rename it to `path` on success, remove it on any error.

    Content and name are on the disk when this returns, so a crash or a power cut leaves the old file or the new one.
    A process that is killed leaves a hidden file `.NAME.*.part`; the next command in an output folder removes it.

    :raises InvalidInput: see `require_writable`.
    """
    path = Path(path)
    require_writable(path)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    temporary = Path(name)
    try:
        os.close(handle)
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        _to_disk(temporary)
        temporary.replace(path)
        _to_disk(path.parent)
    except OSError as error:
        error.filename = error.filename or str(path)  # a full disk names no file
        raise
    finally:
        temporary.unlink(missing_ok=True)


def require_writable(path: Path) -> None:
    """Refuse a path where `atomic_write` could not write a file, or would replace something that is no file.

    :raises InvalidInput: the parent folder does not exist; the path names a folder, a pipe, a device or a socket, or
        leads to an open file of a process, as /dev/stdout does.
    """
    if not path.parent.is_dir():
        raise InvalidInput(f"{path}: folder {path.parent} does not exist; make it or choose another output path")
    if path.is_dir():
        raise InvalidInput(f"{path}: expected a file to write, found a folder; give the name of a file")
    if path.is_symlink() and {path.parent.resolve().parts[:2], path.readlink().parts[:2]} & {("/", "proc")}:
        raise InvalidInput(
            f"{path}: expected a file to write, found an open file of a process; give the name of a file"
        )
    if path.exists() and not path.is_file():
        raise InvalidInput(
            f"{path}: expected a file to write, found a pipe, a device or a socket, which a file would replace; give "
            "the name of a file"
        )


def _to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_text(path: str | Path, text: str) -> None:
    """Write `text` as `path`, whole or not at all; errors as `atomic_write`."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")


def write_json(path: str | Path, values: Any) -> None:
    """Write JSON values, numbers finite or not, as `path`, whole or not at all; errors as `atomic_write`."""
    write_text(path, json.dumps(values, indent=2) + "\n")


def is_empty_folder(path: Path) -> bool:
    """Return whether a folder holds nothing but `FAILURE`, the file of a command that failed."""
    return all(inside.name == FAILURE for inside in path.iterdir())


def require_empty_folder(path: str | Path) -> Path:
    """Return the empty folder `path`, created if it did not exist; refuse a folder that is not empty.

    :raises InvalidInput: it exists and holds anything but `FAILURE`, or is not a folder.
    """
    path = Path(path)
    if path.exists() and not path.is_dir():
        raise InvalidInput(f"{path}: expected a folder for the output, found a file; choose another path")
    if path.is_dir() and not is_empty_folder(path):
        raise InvalidInput(f"{path}: the output folder is not empty; choose another one or empty it first")
    path.mkdir(parents=True, exist_ok=True)
    return path
