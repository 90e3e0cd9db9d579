"""Compilation of functions with numba, and the division of a large batch between threads.

Compiled code is cached on disk, divides as IEEE says and never reorders arithmetic (no fastmath). A module with such
functions touches no file as it is imported: the cache is looked up at the first call of each function.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any, TypeVar

from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher
from numba.types import unliteral

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


class _Part(JITCodeLibrary):  # type: ignore[misc]
    """The code of a kernel that others call: their own compilation optimises it and makes machine code of it."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True


class _PartCompiler(Compiler):  # type: ignore[misc]
    def define_pipelines(self) -> Any:
        self.state.library = _Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.flags.no_compile = True
        return super().define_pipelines()


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """A compiled function.

    Where another kernel calls it, it is a part of that kernel: without machine code, wrapper for Python and file of its
    own, which together cost more than the compilation of a small function. Nor is it compiled for each constant that it
    is called with. Called from Python, it is compiled with all of these.
    """

    @cached_property
    def from_python(self) -> CPUDispatcher:
        """The dispatcher that Python calls."""
        own = CPUDispatcher(self.py_func, targetoptions=self.targetoptions | {"no_cpython_wrapper": False})
        own._cache = _Cache(self.py_func)
        return own

    def __call__(self, *args: Any) -> Any:
        """Call it from Python."""
        return self.from_python(*args)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return how another kernel calls it with arguments of these types."""
        return super().get_call_template([unliteral(arg) for arg in args], kws)

    def add_overload(self, cres: Any) -> None:
        """Store the code for one signature, for other kernels."""
        cres = cres._replace(entry_point=object())  # by which callers find it, in place of an address
        self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [cres.library])
        self.overloads[tuple(cres.signature.args)] = cres


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function with numba; `options` are those of numba's `njit`."""
    own = {"nopython": True, "nogil": True, "error_model": "numpy", **options}
    own |= {"no_cfunc_wrapper": True, "no_cpython_wrapper": True}
    return lambda function: Kernel(function, targetoptions=own, pipeline_class=_PartCompiler)


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
