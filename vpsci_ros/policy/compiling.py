"""Compilation of the kernels of a default run in parallel processes, once for each state of the sources.

numba compiles a kernel at its first call and keeps it on disk (`vpsci_ros.runs.kernel_cache`). Without this module,
every node and every worker of a new installation would compile the same kernels at the same time, without a message. A
node that compiles receives a request to stop only after the compilation, later than a graph waits for on a busy
machine. Where the kernels are compiled, nothing is imported for this check. Kernels of other configurations, such as
several pedestrians, are compiled at their first call.
"""

import fcntl
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from vpsci_ros.runs.kernel_cache import choose_cache_folder

DONE = "compiled"  # a file of this name in the cache folder: all of it has been compiled


def _spawn() -> None:
    from vpsci_ros.world import World, WorldConfig, load_scenarios

    World(WorldConfig(), load_scenarios([1]), [(1, 0)], 1, 0)


def _move() -> None:
    import numpy as np

    from vpsci_ros.data.episode_block import EpisodeFrames
    from vpsci_ros.data.filters import FilterConfig, apply_filters
    from vpsci_ros.world import World, WorldConfig, load_scenarios
    from vpsci_ros.world.loop import Loop

    step = Loop(World(WorldConfig(), load_scenarios([1]), [], 1, 0, first_tick=1)).step()  # a policy tick would spawn
    EpisodeFrames(1, 2, floats=np.float64).add(step)
    apply_filters(EpisodeFrames(1, 2).add(step), FilterConfig())


def _act(policy: str) -> None:
    import numpy as np

    from vpsci_ros.policy.agent import policies
    from vpsci_ros.policy.policy_file import load_policy
    from vpsci_ros.world import World, WorldConfig, load_scenarios
    from vpsci_ros.world.state import EPISODE, RUNNING
    from vpsci_ros.world.tick import Tick

    state = np.zeros(1, EPISODE)
    state["status"] = RUNNING
    yes = np.ones(1, np.bool_)
    tick = Tick(number=0, state=state, policy_frame=yes, by_policies=True)
    world = World(WorldConfig(), load_scenarios([1]), [], 1, 0, first_tick=1)
    for agent in policies(load_policy(policy), world).values():
        agent.act(tick, tick.assessed(np.ones(1), np.ones(1), yes))


PARTS: dict[str, Callable[[], None]] = {
    "spawn": _spawn,
    "move": _move,
    "people": partial(_act, "people"),
    "network": partial(_act, "ma_sst_ddpg"),
}


def compile_kernels() -> None:
    """Print a message and compile `PARTS`, unless the cache has them or there is no cache folder to write to.

    A part that fails is printed with its reason; the process that needs its kernels compiles them, or reports an error.
    """
    folder = choose_cache_folder()
    if folder is None or not folder.is_absolute() or (folder / DONE).exists():
        return
    with (folder / "compiling").open("w") as lock:  # several workers of a cluster start at once on a machine
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / DONE).exists():
            _compile(folder)


def _compile(folder: Path) -> None:
    print("compiling for this machine, once: up to a minute", file=sys.stderr, flush=True)
    command = [sys.executable, "-m", __name__]
    running = [subprocess.Popen([*command, part], stderr=subprocess.PIPE, text=True) for part in PARTS]
    errors = [process.communicate()[1] for process in running]
    for part, process, error in zip(PARTS, running, errors, strict=True):
        if process.returncode:
            last = (error.strip().splitlines() or ["no reason given"])[-1]
            print(f"note: compiling beforehand: {part} ended with {process.returncode}: {last}", file=sys.stderr)
    if not any(process.returncode for process in running):
        (folder / DONE).touch()


if __name__ == "__main__":
    PARTS[sys.argv[1]]()
