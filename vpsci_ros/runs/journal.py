"""A journal of resumable work: which of its items are done, torn, or of other work.

An item has a name, bytes, and the work that made it: all that the bytes depend on. It is a file that begins with its
seal, or a folder of files whose record is written last. No index lists the items: several machines make items of one
work, and a process that is killed leaves whole items and torn ones, which are made again.
"""

import hashlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.documents import read_json, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import atomic_write, changed_files, require_empty_folder, sha256, write_json
from vpsci_ros.runs.identity import require_same

OUTPUTS = "outputs_sha256"  # of a record: the hash of each file, by name
_SEAL = hashlib.sha256().digest_size  # bytes at the beginning of a file


def claim(path: Path, work: Mapping[str, Any], what: str = "holds a run") -> None:
    """Store what the work in a new folder is, or check that the folder has the same work.

    :param path: of the file that says it.
    :param work: JSON values.
    :param what: the folder does, for the error message.
    :raises InvalidInput: the folder has other work or anything else.
    """
    if path.is_file():
        require_same(path.parent, stored_work(path), work, what)
        return
    require_empty_folder(path.parent)
    write_json(path, work)


def stored_work(path: Path) -> dict[str, Any]:
    """Return what `claim` has stored.

    :raises InvalidInput: the file holds something else.
    """
    found = read_json(path)
    require_form(found, dict, f"{path}: not what this command writes; choose another output folder")
    return dict(found)


def write_item(path: Path, work: bytes, data: bytes | memoryview) -> None:
    """Write an item that is a file, whole or not at all; errors as `atomic_write`.

    :param work: what the item is: the work that made it, and its name.
    """
    with atomic_write(path) as part, part.open("wb") as file:
        file.write(_seal(work, data))
        file.write(data)


def read_item(path: Path, work: bytes) -> memoryview | None:
    """Return the bytes of an item that is a file; None if it is missing, torn, or of other work."""
    try:
        whole = memoryview(path.read_bytes())
    except OSError:
        return None
    data = whole[_SEAL:]
    return data if data and whole[:_SEAL] == _seal(work, data) else None


def _seal(work: bytes, data: bytes | memoryview) -> bytes:
    digest = hashlib.sha256(hashlib.sha256(work).digest())
    digest.update(data)
    return digest.digest()


def hashes(folder: Path, *without: str) -> dict[str, str]:
    """Return the SHA-256 of each file in a folder by its name there, in order.

    :param without: ends of the names of files that are left out.
    """
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file() and not path.name.endswith(without)]
    return {path.relative_to(folder).as_posix(): sha256(path) for path in paths}


def write_item_record(path: Path, work: Mapping[str, Any]) -> None:
    """Write the record of an item that is a folder: the work that made it, and the hash of each file that is there.

    :param path: of the record, which lies in the folder.
    :param work: JSON values.
    """
    write_json(path, {**work, OUTPUTS: hashes(path.parent, path.name)})


def finished(path: Path, work: Mapping[str, Any], again: str = "") -> dict[str, Any] | None:
    """Return the record of an item that is a folder; None if it is not finished, torn, or of other work.

    :param path: of the record.
    :param work: values that the record must have.
    :param again: what happens to a torn item or one of other work, said on standard error; empty: nothing is said.
    """
    if not path.is_file():
        return None
    try:
        record = read_json(path)
        require_form(record, {OUTPUTS: {"*": str}}, str(path))
        if changed := changed_files(path.parent, record[OUTPUTS]):
            raise InvalidInput(f"{path.parent}: {', '.join(changed)} changed since it was written")
        if any(name not in record or record[name] != value for name, value in work.items()):
            raise InvalidInput(f"{path.parent}: the result of another run")
    except InvalidInput as error:
        if again:
            print(f"note: {error}; {again}", file=sys.stderr)
        return None
    return dict(record)
