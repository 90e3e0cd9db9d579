"""Compilation of functions with numba, and the division of a large batch between threads.

Compiled code is cached on disk, divides as IEEE says and never reorders arithmetic (no fastmath). A module with such
functions touches no file as it is imported: the cache is looked up at the first call of each function.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any, TypeVar

from numba import njit
from numba.core.caching import FunctionCache

from vpsci_ros.runs.kernel_cache import choose_cache_folder

T = TypeVar("T")


class _Cache:
    """Numba's cache of compiled code on disk; where a file cannot be loaded, the function is compiled again.

    It has the methods that numba's dispatcher calls.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @cached_property
    def _on_disk(self) -> FunctionCache:
        choose_cache_folder()
        return FunctionCache(self._function)

    @property
    def cache_path(self) -> str:
        return str(self._on_disk.cache_path)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return self._on_disk.load_overload(sig, target_context)
        except Exception:  # noqa: BLE001  # pickle and LLVM raise errors of any kind for a damaged file
            self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        self._on_disk.save_overload(sig, data)

    def flush(self) -> None:
        self._on_disk.flush()


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function with numba; `options` are those of numba's `njit`."""

    def decorated(function: Callable[..., Any]) -> Any:
        dispatcher = njit(no_cfunc_wrapper=True, error_model="numpy", nogil=True, **options)(function)
        dispatcher._cache = _Cache(function)
        return dispatcher

    return decorated


kernel = compiled()


class _Pool:
    """Threads that live as long as the process, made when first needed."""

    def __init__(self) -> None:
        self.size = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self.executor: ThreadPoolExecutor | None = None

    def get(self) -> ThreadPoolExecutor:
        if self.executor is None:
            self.executor = ThreadPoolExecutor(self.size, thread_name_prefix="vpsci_kernels")
        return self.executor


_pool = _Pool()
os.register_at_fork(after_in_child=_pool.__init__)  # type: ignore[misc]


def in_threads(run: Callable[[slice], T], size: int, per_thread: int, together: int = 1) -> list[T]:
    """Call `run` on slices of range(size), in several threads if `size` is large; return the results in order.

    `run` is a kernel that releases the interpreter lock and treats each index for itself, so the split changes no bit.

    :param per_thread: number of indices below which another thread costs more than it saves.
    :param together: slices begin at multiples of `together`; `size` is a multiple, too.
    """
    count = max(1, min(_pool.size, size // per_thread))
    groups = size // together
    parts = [slice(groups * k // count * together, groups * (k + 1) // count * together) for k in range(count)]
    others = [_pool.get().submit(run, part) for part in parts[1:]]
    return [run(parts[0]), *(other.result() for other in others)]
