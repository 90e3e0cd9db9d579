"""How the world's scalar code is compiled, and how a large batch is shared between threads.

Compiled code is cached on disk, divides as IEEE says and never reorders arithmetic (no fastmath). It counts no
references to its arrays (`_nrt`), which would cost more than the arithmetic, so it cannot make arrays of its own. What
takes the whole state is `inlined` where it is called from the loop over slots, since passing a dozen arrays costs more
than most of what these functions do.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from numba import njit

kernel = njit(cache=True, error_model="numpy", nogil=True, _nrt=False)
inlined = njit(cache=True, error_model="numpy", nogil=True, _nrt=False, inline="always")

_PER_THREAD = 2048  # slots below which another thread costs more than it saves


class _Pool:
    """Threads that live as long as the process, made when first needed."""

    def __init__(self) -> None:
        self.size = len(os.sched_getaffinity(0))
        self.executor: ThreadPoolExecutor | None = None

    def get(self) -> ThreadPoolExecutor:
        if self.executor is None:
            self.executor = ThreadPoolExecutor(self.size, thread_name_prefix="vpsci_world")
        return self.executor


_pool = _Pool()
os.register_at_fork(after_in_child=_pool.__init__)  # type: ignore[misc]


def in_threads(run: Callable[[slice], None], size: int, together: int = 1) -> None:
    """Call `run` on slices that make up range(size), in several threads where `size` is worth it.

    A slice begins at a multiple of `together`, of which `size` is one, too.

    `run` is a kernel that leaves the interpreter lock and treats each index for itself, so the split changes no bit.
    """
    count = max(1, min(_pool.size, size // _PER_THREAD))
    groups = size // together
    parts = [slice(groups * k // count * together, groups * (k + 1) // count * together) for k in range(count)]
    others = [_pool.get().submit(run, part) for part in parts[1:]]
    run(parts[0])
    for other in others:
        other.result()
