"""Where compiled kernels are kept: a folder of the user's own, without files that were cut."""

import os
import subprocess
import sys
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


def look_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Choose the cache as the next process does, which removes what is damaged."""
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    kernel_cache.choose_cache_folder()


def test_a_kernel_whose_kept_file_was_cut_is_compiled_again(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    subprocess.run([sys.executable, tmp_path / "kernel.py"], check=True)
    (code,), (index,) = cache.rglob("*.nbc"), cache.rglob("*.nbi")
    whole = code.read_bytes()
    code.write_bytes(whole[: whole.rindex(b".", 0, -1) + 1])  # behind a byte that ends pickles
    index.write_bytes(b"")
    look_again(monkeypatch)
    assert not code.exists()
    assert not index.exists()
    subprocess.run([sys.executable, tmp_path / "kernel.py"], check=True)
    look_again(monkeypatch)
    assert code.exists(), "what is whole stays"
    written, data = code.stat().st_mtime_ns, bytearray(code.read_bytes())
    data[len(data) // 2] ^= 1  # a whole pickle still
    code.write_bytes(data)
    os.utime(code, ns=(written, written))
    look_again(monkeypatch)
    assert not code.exists(), "what the disk has changed goes"


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
