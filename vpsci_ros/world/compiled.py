"""Compilation of the world's scalar code, as in `vpsci_ros.safety.compiled`, for calls at every tick.

Compiled so, code does not count references to arrays (`_nrt`), which would cost more than the arithmetic, and cannot
make arrays. A function of the whole state is `inlined`, by LLVM, where the loop over slots calls it, since passing a
dozen arrays costs more than most of these functions do.
"""

from collections.abc import Mapping

from vpsci_ros.safety.compiled import Kernel, compiled

kernel = compiled(_nrt=False)
inlined = compiled(_nrt=False, forceinline=True)
PER_THREAD = 2048  # slots below which another thread costs more than it saves
SPAWNS_PER_THREAD = 16  # episodes that start at once, likewise: a start takes some 30 us


def choice(kernels: Mapping[int, Kernel]) -> Kernel:
    """Return a kernel of a key and arguments, which calls `kernels[key]` with these arguments.

    The kernels take and return values of the same types. They become an if-chain, for numba cannot look one up: each
    link of it compares the key with its own and knows the next link; the last one does not compare.
    """
    (own, kernel), *others = kernels.items()
    if not others:
        last: Kernel = inlined(lambda _key, *arguments: kernel(*arguments))
        return last
    rest = choice(dict(others))

    @inlined
    def chosen(key, *arguments):  # type: ignore[no-untyped-def]
        if key == own:
            return kernel(*arguments)
        return rest(key, *arguments)

    return chosen
