"""Commands from which something is taken while they run, and the same command again.

- *folders*: the output folder is deleted, moved away, or moved and replaced by a link to another one.
- *limits*: the command may open so many files, have so much memory, or start so many processes and threads.
- *again*: the command is killed, and then given once more.

A command ends with 0 and a whole result, or not with 0 and in words, without a traceback. Nothing is written where a
link leads. Given again after it was killed, it ends with 0 and leaves what an undisturbed one leaves, but for times;
one that does not go on with a folder either does that or refuses the folder in words.
"""

import contextlib
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import NamedTuple

from chaos.commands import COMMANDS, PATIENCE, Ended, apart, fresh

from vpsci_ros.runs.files import changed_files, is_empty_folder

WAYS = ("deleted", "moved", "linked")
LIMITS = ("files", "memory", "processes")
RESUMED = ("pretrain", "refine", "realism", "ads-test", "search", "generate, learned", "study samples", "study models")
RESUMED += ("study folds", "study weights", "export to osi", "turing make")
ONCE = ("report", "study paper", "dataset bag", "view", "evaluate", "turing score", "bag export", "import")
KILLED = ("killed at a time", "killed at a file")
REFUSED = 2
LONG = (*RESUMED, "graph", "ads-test, graph", "report", "study paper")
_OTHER_USER = "65534"  # a limit of processes does not hold for root
_TIMES = ("wall_time", "seconds", "time", "date", "begun", "ended", "created", "hours", "started", "finished")
_TIMES += ("computed",)  # what this run itself has done


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
    found = in_words(ended) + left_unmarked(ended, folder / "out")
    if ended.status == REFUSED and "which is not installed" not in ended.said:
        found.append(f"refused, though nothing given was wrong: {ended.said.strip()[-160:]}")
    return ended.status, found


def left_unmarked(ended: Ended, out: Path) -> list[str]:
    """Return that a command failed and left what could be taken for a result."""
    from chaos.disks import _is_marked

    if ended.status in (0, 2) or not out.is_dir() or is_empty_folder(out) or _is_marked(out):
        return []
    return [f"status {ended.status}, and nothing says so among {sorted(path.name for path in out.iterdir())[:5]}"]


# ---- killed, and the same command again


def again_case(seed: int) -> Case:
    """Draw a case: killed at a share of an undisturbed run's time, or as soon as a share of its files has appeared."""
    rng, names = random.Random(f"again/{seed}"), [*RESUMED, *ONCE]
    return Case(names[seed % len(names)], KILLED[seed // len(names) % len(KILLED)], rng.random())


class Whole(NamedTuple):
    """What an undisturbed command left, in how many seconds, and how many names of files there were meanwhile."""

    left: dict[str, str]
    seconds: float
    names: int


_WHOLE: dict[str, Whole] = {}  # by the name of the command


def run_again(case: Case, given: dict[str, str], folder: Path) -> tuple[int, list[str]]:
    """Kill a command and give it again; return the status of the killed one, and what does not hold."""
    out = fresh(folder) / "out"
    if case.command not in _WHOLE:
        _WHOLE[case.command] = _undisturbed(case.command, given, out)
        fresh(folder)
    whole = _WHOLE[case.command]

    def kill(process: "subprocess.Popen[bytes]") -> None:
        if case.way == KILLED[0]:
            _watch(process, out, seconds=case.number * whole.seconds)
        else:
            _watch(process, out, names=2 + int(case.number * whole.names))  # one is what it says
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)

    killed = apart(case.command, out, given, kill)
    ended = apart(case.command, out, given)
    if ended.status == REFUSED and case.command in ONCE and out.is_dir() and any(out.iterdir()):
        return killed.status, in_words(ended)
    if ended.status:
        return killed.status, [*in_words(ended), f"given again, it ended with {ended.status}: {ended.said[-200:]}"]
    found = left(out.parent)
    other = sorted(name for name in whole.left.keys() | found.keys() if whole.left.get(name) != found.get(name))
    return killed.status, [f"given again, it left other content in {', '.join(other)}"] if other else []


def _undisturbed(command: str, given: dict[str, str], out: Path) -> Whole:
    begun, names = time.monotonic(), 0

    def watch(process: "subprocess.Popen[bytes]") -> None:
        nonlocal names
        names = _watch(process, out)

    ended = apart(command, out, given, watch)
    assert ended.status == 0, f"undisturbed: {ended.said[-200:]}"
    return Whole(left(out.parent), time.monotonic() - begun, names)


def _watch(process: "subprocess.Popen[bytes]", out: Path, seconds: float = inf, names: float = inf) -> int:
    """Watch a command until so much time has passed, so many names of files have appeared, or it has ended.

    :return: how many names there were. Names of temporary files are random, so that they count each time.
    """
    seen: set[tuple[str, str]] = set()
    deadline = time.monotonic() + min(seconds, PATIENCE)
    while process.poll() is None and time.monotonic() < deadline and len(seen) < names:
        seen |= {(place, name) for place, _, files in os.walk(out.parent) for name in files}
        time.sleep(0.002)
    return len(seen)


def left(out: Path) -> dict[str, str]:
    """Return a hash of every file of a folder; of records and tables of times, of what is no time in them."""
    return {str(path.relative_to(out)): _hash(path) for path in sorted(out.rglob("*")) if path.is_file()}


def _hash(path: Path) -> str:
    data = path.read_bytes()
    if path.suffix == ".json":
        value = json.loads(data)
        if isinstance(value, dict) and (hashes := value.get("outputs_sha256")):  # some are of files that hold times
            value["outputs_sha256"] = [sorted(hashes), changed_files(path.parent, hashes)]
        data = json.dumps(_timeless(value), sort_keys=True).encode()
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
