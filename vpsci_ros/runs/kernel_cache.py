"""The cache of compiled kernels: one folder for each state of the sources.

The module that compiles kernels chooses it at the first compilation (`safety.compiled`).

Numba keeps compiled code on disk and looks only at the file in which a function stands, so it would go on using a
kernel after an edit to a function that the kernel calls from another file. Here every state of the sources has its
own folder, and folders of earlier states of the same installation are removed.

What numba keeps there are pickles, which can run anything where they are loaded: the folder is the user's own and gets
mode 0700; the folder of another user is not used.
"""

import hashlib
import os
import shutil
import sys
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
_ROOMS = ("policy", "safety", "world")


def choose_cache_folder() -> Path | None:
    """Point numba to the folder of the present sources, unless `NUMBA_CACHE_DIR` names one; return the folder.

    None: there is no home to write to, or the folder belongs to another user; numba then looks for a place of its own.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen)
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vpsci_ros"
    installation = root / hashlib.sha256(str(_PACKAGE).encode()).hexdigest()[:16]
    folder = installation / _digest()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if root.stat().st_uid != os.getuid():
            return None  # another user could have this process run anything
        root.chmod(0o700)
        for other in installation.iterdir():
            if other != folder:
                shutil.rmtree(other, ignore_errors=True)
    except OSError:
        return None
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    return folder


def _digest() -> str:
    """Return a hash of every source file that a kernel's code can come from: those of `_ROOMS`, and all with njit."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if path.relative_to(_PACKAGE).parts[0] in _ROOMS or (b"njit" in text and path != Path(__file__).resolve()):
            digest.update(str(path.relative_to(_PACKAGE)).encode() + hashlib.sha256(text).digest())
    return digest.hexdigest()[:16]
