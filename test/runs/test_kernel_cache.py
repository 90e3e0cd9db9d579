"""Where compiled kernels are kept: a folder of the user's own, without files that were cut."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from vpsci_ros.runs import kernel_cache

KERNEL = """
from numba import njit
@njit(cache=True)
def double(x):
    return 2.0 * x
assert double(1.0) == 2.0
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kernel_cache.choose_cache_folder()
    return Path(os.environ["NUMBA_CACHE_DIR"])


def cut_behind_a_byte_that_ends_pickles(data: bytes) -> bytes:
    return data[: data.rindex(b".", 0, -1) + 1]


@pytest.mark.parametrize(("kind", "spoil"), [("nbi", lambda _: b""), ("nbc", cut_behind_a_byte_that_ends_pickles)])
def test_a_kernel_whose_kept_file_was_cut_is_compiled_again(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, spoil: Callable[[bytes], bytes]
) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    subprocess.run([sys.executable, tmp_path / "kernel.py"], check=True)
    (kept,) = cache.rglob(f"*.{kind}")
    kept.write_bytes(spoil(kept.read_bytes()))
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    kernel_cache.choose_cache_folder()
    assert not kept.exists()
    subprocess.run([sys.executable, tmp_path / "kernel.py"], check=True)
    assert kept.exists()
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    kernel_cache.choose_cache_folder()
    assert kept.exists(), "what is whole stays"
    written, data = kept.stat().st_mtime_ns, bytearray(kept.read_bytes())
    data[len(data) // 2] ^= 1  # a whole pickle still
    kept.write_bytes(data)
    os.utime(kept, ns=(written, written))
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    kernel_cache.choose_cache_folder()
    assert not kept.exists(), "what the disk has changed goes"


def test_only_the_user_may_write_what_is_loaded_and_anothers_folder_is_not_used(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "vpsci_ros").chmod(0o777)
    for user, used in ((os.getuid(), True), (os.getuid() + 1, False)):
        monkeypatch.delenv("NUMBA_CACHE_DIR")
        monkeypatch.setattr(os, "getuid", lambda user=user: user)
        kernel_cache.choose_cache_folder()
        assert ("NUMBA_CACHE_DIR" in os.environ) == used
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
        assert (tmp_path / "vpsci_ros").stat().st_mode & 0o777 == 0o700
