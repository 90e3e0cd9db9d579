"""Compilation of the world's scalar code, as in `vpsci_ros.safety.compiled`, for calls at every tick.

Compiled so, code does not count references to arrays (`_nrt`), which would cost more than the arithmetic, and cannot
make arrays. A function of the whole state is `inlined`, by LLVM, where the loop over slots calls it, since passing a
dozen arrays costs more than most of these functions do.
"""

from vpsci_ros.safety.compiled import compiled

kernel = compiled(_nrt=False)
inlined = compiled(_nrt=False, forceinline=True)
PER_THREAD = 2048  # slots below which another thread costs more than it saves
SPAWNS_PER_THREAD = 16  # episodes that start at once, likewise: a start takes some 30 us
