"""Commands that write to disks which are full, read-only or limited.

A command ends with 0 and what it always writes, or not with 0, one line that says why, and nothing that could be taken
for a result: a file is there whole or not at all, and a folder that holds anything says that the command failed.
The disks are real: small file systems in memory, mounted for a case. That takes root, or `unshare -rm` before the
command. One of them refuses nothing, and every command has to succeed there: one that fails proves nothing elsewhere.
"""

import contextlib
import json
import random
import resource
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from chaos import commands

from vpsci_ros.runs.files import FAILURE
from vpsci_ros.runs.record import RECORD

PLACES = ("free", "full", "filling", "read-only", "limited")


class Case(NamedTuple):
    """A command on a disk: `size` [KiB] is how much room there is, or how large a file may become."""

    command: str
    place: str
    size: int

    def __str__(self) -> str:
        return f"{self.command} on a disk that is {self.place}, {self.size} KiB"


def case(seed: int, names: tuple[str, ...] = tuple(commands.COMMANDS)) -> Case:
    """Draw a case; in each round every command meets every place once, but for the room that is left there."""
    rng = random.Random(f"disks/{seed}")
    place = PLACES[seed // len(names) % len(PLACES)]
    return Case(names[seed % len(names)], place, 0 if place == "full" else round(2 ** rng.uniform(0, 12)))


@contextlib.contextmanager
def disk(case: Case, folder: Path) -> Iterator[Path]:
    """Mount the disk of a case in `folder`."""
    size = case.size if case.place == "filling" else 8 if case.place == "full" else 65536
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={max(size, 4)}k", "chaos", str(folder)], check=True)
    try:
        if case.place == "full":
            with contextlib.suppress(OSError), (folder / "full").open("wb") as file:
                while file.write(bytes(4096)):
                    file.flush()
        elif case.place == "read-only":
            subprocess.run(["mount", "-o", "remount,ro", str(folder)], check=True)
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def run(case: Case, given: dict[str, str]) -> tuple[int, list[str]]:
    """Run the command of a case on its disk, and return its exit status and what does not hold, one sentence each."""
    with tempfile.TemporaryDirectory() as folder, disk(case, Path(folder)) as place:
        largest = case.size * 1024 if case.place == "limited" else resource.RLIM_INFINITY
        ended = commands.here(case.command, place / "out", given, largest)
        found = defects(ended.status, ended.said, place)
    if case.place == "free" and ended.status and "which is not installed" not in ended.said:
        found.append(f"status {ended.status} where nothing is refused: {ended.said.strip()[-120:]}")
    return ended.status, found


def defects(status: int, said: str, place: Path) -> list[str]:
    """Return what does not hold of a command that ended."""
    found = []
    if "Traceback (most recent call last)" in said:
        found.append(f"a traceback: {said.strip().splitlines()[-1]}")
    left = [path for path in place.iterdir() if path.name != "full"]
    if any(path.name.endswith(".part") for path in place.rglob("*")):
        found.append("a part of a file was left")
    if status == 0:
        return found if left else [*found, "status 0, and nothing was written"]
    if status < 0 or not said.strip():
        found.append(f"status {status} without a word")
    for path in left:
        if path.is_file():
            found.append(f"status {status}, but {path.name} is there")
        elif any(path.iterdir()) and not _is_marked(path):
            found.append(f"status {status}, and nothing says so among {sorted(p.name for p in path.iterdir())}")
    return found


def _is_marked(folder: Path) -> bool:
    for name in (FAILURE, RECORD):
        if (folder / name).is_file() and json.loads((folder / name).read_text())["error"]:
            return True
    return False
