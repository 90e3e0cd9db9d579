"""Atomic file writes, empty output folders, and the hash of a file."""

import contextlib
import fcntl
import hashlib
import json
import os
import secrets
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.documents import OUTPUTS, in_utf8, listed, read_json, require_regular
from vpsci_ros.errors import InvalidInput

FAILURE = "failed.json"  # why a command left a folder unfinished
_PART = ".vpsci.part"  # how a file's name ends until the file is whole


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
    A process that is killed leaves a hidden file `.NAME.vpsci.part`, which the next write of NAME takes over.

    :raises InvalidInput: see `require_writable`.
    """
    path = Path(path)
    require_writable(path)
    temporary, handle = _part_of(path)
    try:
        yield temporary if in_utf8(str(path)) == str(path) else Path(f"/proc/self/fd/{handle}")  # see `path_in_utf8`
        _to_disk(temporary)
        temporary.replace(path)
        OUTPUTS.discard(path)
        _to_disk(path.parent)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename = error.filename or str(path)  # a full disk names no file
        raise
    finally:
        os.close(handle)


def _part_of(path: Path) -> tuple[Path, int]:
    """Return a hidden file beside `path`, that of a killed process or a new one, and its handle with a lock."""
    own = path.with_name(f".{path.name}{_PART}")
    with contextlib.ExitStack() as stack, contextlib.suppress(OSError):
        handle = os.open(own, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
        stack.callback(os.close, handle)
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(handle), own.stat()):  # its writer did not rename it meanwhile
            os.ftruncate(handle, 0)
            stack.pop_all()
            return own, handle
    own = path.with_name(f".{path.name}.{secrets.token_hex(6)}{_PART}")
    return own, os.open(own, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)


def require_writable(path: Path) -> None:
    """Refuse a path where `atomic_write` could not write a file, or would replace something that is no file.

    :raises InvalidInput: the parent folder does not exist; the path names a folder, a pipe, a device or a socket, or
        leads to an open file of a process, as /dev/stdout does.
    """
    if not path.parent.is_dir():
        raise InvalidInput(f"{path}: folder {path.parent} does not exist; make it or choose another output path")
    if path.is_dir():
        raise InvalidInput(f"{path}: expected a file to write, found a folder; give the name of a file")
    handle = path.is_symlink() and {path.parent.resolve().parts[:2], path.readlink().parts[:2]} & {("/", "proc")}
    if handle or (path.exists() and not path.is_file()):
        what = "an open file of a process" if handle else "a pipe, a device or a socket, which a file would replace"
        raise InvalidInput(f"{path}: expected a file to write, found {what}; give the name of a file")


def _to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_text(path: str | Path, text: str) -> None:
    """Write `text` as `path`, whole or not at all; errors as `atomic_write`."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8", errors="backslashreplace")  # of names that are not UTF-8


def write_json(path: str | Path, values: Any) -> None:
    """Write JSON values, numbers finite or not, as `path`, whole or not at all; errors as `atomic_write`."""
    write_text(path, json.dumps(values, indent=2) + "\n")


def is_failure(path: Path) -> bool:
    """Return whether a file is the `FAILURE` of a command of this package."""
    with contextlib.suppress(InvalidInput):
        found = read_json(path) if path.name == FAILURE else None
        return isinstance(found, dict) and {"error", "inputs_sha256"} <= found.keys()
    return False


def is_empty_folder(path: Path) -> bool:
    """Return whether a folder holds nothing but `FAILURE`, the file of a command that failed."""
    return not _foreign(path, ())


def _foreign(path: Path, names: Iterable[str]) -> list[str]:
    return sorted(each.name for each in path.iterdir() if not (is_failure(each) or any(map(each.match, names))))


def require_empty_folder(path: str | Path, *names: str) -> Path:
    """Return the folder `path`, created if it did not exist; refuse a folder that is not empty.

    :param names: of files that it may hold, or patterns of a shell: those that the same command writes.
    :raises InvalidInput: it exists and holds anything but these files and `FAILURE`, or is not a folder.
    """
    path = Path(path)
    if path.exists() and not path.is_dir():
        raise InvalidInput(f"{path}: expected a folder for the output, found a file; choose another path")
    path.mkdir(parents=True, exist_ok=True)
    if found := _foreign(path, (*names, f".*{_PART}") if names else ()):
        raise InvalidInput(
            f"{path}: the output folder is not empty: it holds {listed(found)}; choose another one or empty it first"
        )
    return path
