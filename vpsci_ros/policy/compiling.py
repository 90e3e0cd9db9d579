"""Compilation of the kernels of a default run in parallel processes, once for each state of the sources.

numba compiles a kernel at its first call and keeps it on disk (`vpsci_ros.runs.kernel_cache`). Without this module,
every node and every worker of a new installation would compile the same kernels at the same time, without a message. A
node that compiles receives a request to stop only after the compilation, later than a graph waits for on a busy
machine. Kernels of other configurations, such as several pedestrians, are compiled at their first call.
"""

import fcntl
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.policy.weights import Weights
from vpsci_ros.runs.kernel_cache import choose_cache_folder

if TYPE_CHECKING:
    from vpsci_ros.world import World

DONE = "compiled-"  # a file of this name and a part's in the cache folder: the part has been compiled


def _world(*episodes: tuple[int, int], first_tick: int = 1) -> "World":  # a first policy tick would spawn
    from vpsci_ros.world import World, WorldConfig, load_scenarios

    return World(WorldConfig(), load_scenarios([1]), episodes, 1, 0, first_tick=first_tick)


def _move() -> None:
    from vpsci_ros.data.episode_block import EpisodeFrames
    from vpsci_ros.data.filters import FilterConfig, apply_filters
    from vpsci_ros.world.loop import Loop

    apply_filters(EpisodeFrames(1, 2).add(Loop(_world()).step()), FilterConfig())


def _act(policy: str) -> None:
    from vpsci_ros.policy.agent import policies
    from vpsci_ros.policy.policy_file import load_policy

    policies(load_policy(policy), _world())  # which act once as they are loaded


PARTS: dict[str, Callable[[], object]] = {
    "spawn": partial(_world, (1, 0), first_tick=0),
    "people": partial(_act, "people"),
    "move": _move,
    "network": partial(_act, "closed_loop"),
}
SIDE_BY_SIDE = (("spawn", "people"), ("move", "network"))  # parts of one process: two take the same time


def compile_kernels(*policies: Policy) -> None:
    """Print a message and compile the parts that episodes need which the cache lacks, if it has a folder to write to.

    A part that fails is printed with its reason; the process that needs its kernels compiles them, or reports an error.

    :param policies: that act; without any, a bank.
    """
    folder = choose_cache_folder()
    if folder is None or not folder.is_absolute():
        return
    acting = {"network" if isinstance(policy, Weights) else "people" for policy in policies} or {"people"}
    needed = PARTS.keys() - {"people", "network"} | acting
    if all((folder / (DONE + part)).exists() for part in needed):
        return
    with (folder / "compiling").open("w") as lock:  # several workers of a cluster start at once on a machine
        fcntl.flock(lock, fcntl.LOCK_EX)
        _compile(folder, [part for part in PARTS if part in needed and not (folder / (DONE + part)).exists()])


def _compile(folder: Path, parts: Sequence[str]) -> None:
    if parts:
        print(f"compiling for this machine, once, for half a minute: {', '.join(parts)}", file=sys.stderr, flush=True)
    groups = [[part for part in parts if part in group] for group in SIDE_BY_SIDE]
    command = [sys.executable, "-m", __name__]
    started = [subprocess.Popen([*command, *own], stderr=subprocess.PIPE, text=True) for own in groups if own]
    for own, process in zip(filter(None, groups), started, strict=True):
        error = process.communicate()[1]
        if process.returncode:
            last = (error.strip().splitlines() or ["no reason given"])[-1]
            names = " and ".join(own)
            print(f"note: compiling beforehand: {names} ended with {process.returncode}: {last}", file=sys.stderr)
        for part in own if not process.returncode else ():
            (folder / (DONE + part)).touch()


if __name__ == "__main__":
    for name in sys.argv[1:]:
        PARTS[name]()
