"""Commands from which something is taken while they run, and the same command again.

- *folders*: the output folder is deleted, moved away, or moved and replaced by a link to another one.
- *limits*: the command may open so many files, have so much memory, or start so many processes and threads.
- *again*: the command is killed, and then given once more.

A command ends with 0 and a whole result, or not with 0 and in words, without a traceback. Nothing is written where a
link leads. Given again after it was killed, it ends with 0 and leaves what an undisturbed one leaves, but for times.
"""

import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from chaos.commands import COMMANDS, Ended, apart, fresh

WAYS = ("deleted", "moved", "linked")
LIMITS = ("files", "memory", "processes")
RESUMED = ("pretrain", "refine", "realism", "ads-test", "search", "generate, learned", "study samples", "study models")
LONG = (*RESUMED, "graph", "ads-test, graph", "report", "export to osi", "turing make", "study paper")
_OTHER_USER = "65534"  # a limit of processes does not hold for root
_TIMES = ("wall_time", "seconds", "time", "date", "begun", "ended", "created", "hours", "started", "finished")


class Case(NamedTuple):
    """A command, what is taken from it, and the number that says when or how much."""

    command: str
    way: str
    number: float

    def __str__(self) -> str:
        return f"{self.command}, {self.way}, {self.number:.3g}"


# ---- folders


def folder_case(seed: int) -> Case:
    """Draw a case: the folder is taken so many seconds after something lies in it."""
    rng = random.Random(f"folders/{seed}")
    return Case(LONG[seed % len(LONG)], WAYS[seed // len(LONG) % len(WAYS)], rng.choice((0.0, 0.1, 0.5, 2.0)))


def run_folder(case: Case, given: dict[str, str], folder: Path) -> tuple[int, list[str]]:
    """Take the folder away under a command; return its exit status, and what does not hold, one sentence each."""
    out, elsewhere = fresh(folder) / "out", folder / "elsewhere"
    elsewhere.mkdir()

    def take(process: "subprocess.Popen[bytes]") -> None:
        while process.poll() is None and not (out.is_dir() and any(out.iterdir())):
            time.sleep(0.005)
        time.sleep(case.number)
        if process.poll() is not None or not out.is_dir():
            return
        if case.way == "deleted":
            shutil.rmtree(out, ignore_errors=True)
        else:
            out.rename(folder / "away")
        if case.way == "linked":
            out.symlink_to(elsewhere)

    ended = apart(case.command, out, given, take)
    found = in_words(ended)
    taken = (folder / "away").exists() or out.is_symlink() or not out.exists()
    if taken and ended.status == 0:
        found.append("status 0, and its folder is gone")
    if any(elsewhere.iterdir()):
        found.append(f"written where the link leads: {sorted(path.name for path in elsewhere.iterdir())[:3]}")
    return ended.status, found


# ---- limits


def limit_case(seed: int) -> Case:
    """Draw a case: descriptors, address space [MB], or processes and threads of a user."""
    names = [name for name in COMMANDS if name != "demo"]
    rng, way = random.Random(f"limits/{seed}"), LIMITS[seed // len(names) % len(LIMITS)]
    number = {"files": rng.randint(8, 40), "memory": rng.randint(250, 2000), "processes": rng.randint(1, 12)}[way]
    return Case(names[seed % len(names)], way, number)


def run_limit(case: Case, given: dict[str, str], folder: Path) -> tuple[int, list[str]]:
    """Run a command within a limit; return its exit status, and what does not hold, one sentence each."""
    fresh(folder).chmod(0o777)
    number = str(round(case.number * (1e6 if case.way == "memory" else 1)))
    before: tuple[str, ...] = ("prlimit", {"files": "--nofile=", "memory": "--as="}.get(case.way, "--nproc=") + number)
    if case.way == "processes":
        root = ("--inh-caps=+dac_override", "--ambient-caps=+dac_override")
        before = ("setpriv", f"--reuid={_OTHER_USER}", "--clear-groups", *root, *before)
    ended = apart(case.command, folder / "out", given, before=before)
    return ended.status, in_words(ended) + left_unmarked(ended, folder / "out")


def left_unmarked(ended: Ended, out: Path) -> list[str]:
    """Return that a command failed and left what could be taken for a result."""
    from chaos.disks import _is_marked

    if ended.status in (0, 2) or not out.is_dir() or not any(out.iterdir()) or _is_marked(out):
        return []
    return [f"status {ended.status}, and nothing says so among {sorted(path.name for path in out.iterdir())[:5]}"]


# ---- killed, and the same command again


def again_case(seed: int) -> Case:
    """Draw a case: killed so many seconds after it has left something for the first time."""
    rng = random.Random(f"again/{seed}")
    return Case(RESUMED[seed % len(RESUMED)], "killed", rng.choice((0.0, 0.05, 0.3, 1.0, 3.0)))


_WHOLE: dict[str, dict[str, str]] = {}  # what an undisturbed command left, by its name


def run_again(case: Case, given: dict[str, str], folder: Path) -> tuple[int, list[str]]:
    """Kill a command and give it again; return the status of the killed one, and what does not hold."""
    out = fresh(folder) / "out"
    if case.command not in _WHOLE:
        undisturbed = apart(case.command, out, given)
        assert undisturbed.status == 0, f"undisturbed: {undisturbed.said[-200:]}"
        _WHOLE[case.command] = left(out)
        fresh(folder)
    whole = _WHOLE[case.command]

    def kill(process: "subprocess.Popen[bytes]") -> None:
        while process.poll() is None and not (out.is_dir() and any(out.iterdir())):
            time.sleep(0.005)
        time.sleep(case.number)
        os.killpg(process.pid, signal.SIGKILL)

    killed = apart(case.command, out, given, kill)
    ended = apart(case.command, out, given)
    if ended.status:
        return killed.status, [*in_words(ended), f"given again, it ended with {ended.status}: {ended.said[-200:]}"]
    found = left(out)
    other = sorted(name for name in whole.keys() | found.keys() if whole.get(name) != found.get(name))
    return killed.status, [f"given again, it left other content in {', '.join(other)}"] if other else []


def left(out: Path) -> dict[str, str]:
    """Return a hash of every file of a folder; of records and tables of times, of what is no time in them."""
    return {str(path.relative_to(out)): _hash(path) for path in sorted(out.rglob("*")) if path.is_file()}


def _hash(path: Path) -> str:
    data = path.read_bytes()
    if path.suffix == ".json":
        data = json.dumps(_timeless(json.loads(data)), sort_keys=True).encode()
    return hashlib.sha256(data).hexdigest()


def _timeless(value: object) -> object:
    if isinstance(value, dict):
        return {name: _timeless(part) for name, part in value.items() if not any(time in name for time in _TIMES)}
    return [_timeless(part) for part in value] if isinstance(value, list) else value


# ---- all of them


def in_words(ended: Ended) -> list[str]:
    """Return what does not hold of how a command ended."""
    if "Traceback (most recent call last)" in ended.said:
        return [f"a traceback: {ended.said.strip().splitlines()[-1][:160]}"]
    if ended.status < 0:
        return [f"ended by signal {-ended.status}: {ended.said.strip()[-100:]}"]
    return ["ended without a word"] if ended.status and not ended.said.strip() else []


Runner = Callable[[Case, dict[str, str], Path], tuple[int, list[str]]]
CAMPAIGNS: dict[str, tuple[Callable[[int], Case], Runner]] = {
    "folders": (folder_case, run_folder),
    "limits": (limit_case, run_limit),
    "again": (again_case, run_again),
}
