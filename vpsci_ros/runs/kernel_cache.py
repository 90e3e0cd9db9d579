"""Where compiled kernels are kept: a folder of its own for each state of the sources.

The module that compiles kernels chooses it (`safety.compiled`).

Numba keeps compiled code on disk and looks only at the file in which a function stands, so it would go on using a
kernel after an edit to a function that the kernel calls from another file. Here every state of the sources has its
own folder, and folders of earlier states of the same installation are removed.

What numba keeps there are pickles, which can run anything where they are loaded: the folder is the user's own, with
mode 0700, and one that others can write to is not used. Files that a crash or a full disk has cut or changed are
removed, since numba ends in an error of theirs instead of compiling again.
"""

import contextlib
import hashlib
import io
import json
import os
import pickletools
import shutil
import sys
import zlib
from pathlib import Path

from vpsci_ros.runs.files import written_whole

_PACKAGE = Path(__file__).resolve().parents[1]
_ROOMS = ("policy", "safety", "world")
CHECKSUMS = "checksums.json"  # path of a file of numba's -> when it was written [ns], and its checksum


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
        _remove_damaged_files(folder)
        for other in installation.iterdir():
            if other != folder:
                shutil.rmtree(other, ignore_errors=True)
    except OSError:
        return None
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    return folder


def _remove_damaged_files(folder: Path) -> None:
    """Remove each file of numba's that is not whole; it is compiled and written again.

    A file is whole if its checksum is the one of the last look at the same state of it, or, where it is new since, if
    it holds as many whole pickles as numba writes there; these are not loaded for it.
    """
    seen: dict[str, list[int]] = {}
    with contextlib.suppress(OSError, ValueError, AttributeError):
        seen = dict(json.loads((folder / CHECKSUMS).read_text()).items())
    whole: dict[str, list[int]] = {}
    for path in sorted(folder.rglob("*.nb[ic]")):
        with contextlib.suppress(FileNotFoundError):  # another process removes it as well
            name, written, data = str(path.relative_to(folder)), path.stat().st_mtime_ns, path.read_bytes()
            state = [written, zlib.crc32(data)]
            before = seen.get(name, [0])
            if before == state or (before[0] != written and _pickles(data) == {".nbi": 2, ".nbc": 1}[path.suffix]):
                whole[name] = state
            else:
                path.unlink()
    if whole != seen:
        with written_whole(folder / CHECKSUMS) as part:
            part.write_text(json.dumps(whole))


def _pickles(data: bytes) -> int:
    """Return how many pickles follow one another in some bytes; 0 where the last one breaks off."""
    stream, count = io.BytesIO(data), 0
    try:
        while stream.tell() < len(data):
            for _ in pickletools.genops(stream):
                pass
            count += 1
    except ValueError:
        return 0
    return count


def _digest() -> str:
    """Return a hash of every source file that a kernel's code can come from: rooms below the kernels, and kernels."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if path.parent.name in _ROOMS or (b"njit" in text and path != Path(__file__).resolve()):
            digest.update(str(path.relative_to(_PACKAGE)).encode() + hashlib.sha256(text).digest())
    return digest.hexdigest()[:16]
