"""Where compiled kernels are kept: a folder of its own for each state of the sources.

Numba keeps compiled code on disk and looks only at the file in which a function stands, so it would go on using a
kernel after an edit to a function that the kernel calls from another file. Here every state of the sources has its
own folder, and folders of earlier states of the same installation are removed.
"""

import hashlib
import os
import shutil
import sys
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
_ROOMS = ("safety", "world")


def choose_cache_folder() -> None:
    """Point numba to the folder of the present sources, unless `NUMBA_CACHE_DIR` names one."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vpsci_ros"
    installation = root / hashlib.sha256(str(_PACKAGE).encode()).hexdigest()[:16]
    folder = installation / _digest()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for other in installation.iterdir():
            if other != folder:
                shutil.rmtree(other, ignore_errors=True)
    except OSError:
        return  # no home to write to: numba then looks for a place of its own
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def _digest() -> str:
    """Return a hash of every source file that a kernel's code can come from: rooms below the kernels, and kernels."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if path.parent.name in _ROOMS or b"njit" in text:
            digest.update(str(path.relative_to(_PACKAGE)).encode() + hashlib.sha256(text).digest())
    return digest.hexdigest()[:16]
