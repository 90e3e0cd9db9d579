"""Files that appear whole or not at all, output folders that are nobody else's, and the hash of a file."""

import contextlib
import fcntl
import glob
import hashlib
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.documents import require_regular
from vpsci_ros.errors import InvalidInput, VpsciError

INHERITED = "VPSCI_OUTPUT_FOLDERS"  # environment variable in which a child process finds them, as JSON
CLAIMED: dict[tuple[int, int], Path] = {
    (device, inode): Path(path) for device, inode, path in json.loads(os.environ.get(INHERITED) or "[]")
}
"""Device and inode of each folder that this process or its parent has claimed -> the path by which it writes there."""
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
    """Return which files of a folder are missing, or not those of which these are the SHA-256 by name."""
    return [name for name, own in hashes.items() if not (folder / name).is_file() or sha256(folder / name) != own]


@contextlib.contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; rename it to `path` on success, remove it on any error.

    Content and name are on the disk when this returns, so that neither a crash nor a power cut leaves less. The
    temporary file is locked while this process lives. What an earlier process left of the same file, when it was
    killed, is removed here where no output folder is claimed (`remove_parts` does it there).

    :raises InvalidInput: see `require_writable`.
    :raises VpsciError: an output folder above it was deleted, moved or replaced since it was claimed.
    """
    path = Path(path)
    require_claimed(path)
    require_writable(path)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    temporary = Path(name)
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not CLAIMED:
            _remove_parts_of(path)
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        _to_disk(temporary)
        require_claimed(path)
        temporary.replace(path)
        _to_disk(path.parent)
    finally:
        temporary.unlink(missing_ok=True)
        os.close(handle)


def require_writable(path: Path) -> None:
    """Refuse a path where `written_whole` could not write a file, or would put one in the place of something else.

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


def _remove_parts_of(path: Path) -> None:
    """Remove the temporary files of `path` that no process has locked: their processes were killed."""
    for part in path.parent.glob(f".{glob.escape(path.name)}.{'[a-z0-9_]' * 8}.part"):
        with contextlib.suppress(OSError):
            handle = os.open(part, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                part.unlink()
            finally:
                os.close(handle)


def remove_parts(folder: Path) -> None:
    """Remove the temporary files that `written_whole` left in a folder where its process was killed."""
    for path in folder.rglob(".*.part"):
        path.unlink(missing_ok=True)


def require_claimed(path: Path) -> None:
    """Refuse to write by a path that leads out of the output folder it names.

    :raises VpsciError: an output folder above it was deleted, moved or replaced since it was claimed.
    """
    for identity, folder in CLAIMED.items():
        if path.absolute().is_relative_to(folder) and not is_at(identity, folder):
            raise VpsciError(f"{folder}: this folder was deleted, moved or replaced while it was being written")


def inherited_claims() -> dict[str, str]:
    """Return the environment by which a child process refuses to write where it would leave a claimed folder."""
    return {INHERITED: json.dumps([[*identity, str(folder)] for identity, folder in CLAIMED.items()])}


def is_at(identity: tuple[int, int], path: Path) -> bool:
    """Return whether the folder of this device and inode is still what the path names."""
    with contextlib.suppress(OSError):
        status = path.stat()
        return (status.st_dev, status.st_ino) == identity
    return False


def _to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_text(path: str | Path, text: str) -> None:
    """Write `text` as `path`, whole or not at all; errors as `written_whole`."""
    with written_whole(path) as part:
        part.write_text(text, encoding="utf-8")


def write_json(path: str | Path, values: Any) -> None:
    """Write JSON values, numbers finite or not, as `path`, whole or not at all; errors as `written_whole`."""
    write_text(path, json.dumps(values, indent=2) + "\n")


def is_empty_folder(path: Path) -> bool:
    """Return whether a folder holds nothing but the mark of a command that failed at once."""
    return all(inside.name == FAILURE for inside in path.iterdir())


def require_empty_folder(path: str | Path) -> Path:
    """Create folder `path` if need be and return it.

    :raises InvalidInput: it exists and holds anything, or is not a folder.
    :raises VpsciError: it lies in an output folder that was deleted, moved or replaced.
    """
    path = Path(path)
    require_claimed(path)
    if path.exists() and not path.is_dir():
        raise InvalidInput(f"{path}: expected a folder for the output, found a file; choose another path")
    if path.is_dir() and not is_empty_folder(path):
        raise InvalidInput(f"{path}: the output folder is not empty; choose another one or empty it first")
    path.mkdir(parents=True, exist_ok=True)
    return path
