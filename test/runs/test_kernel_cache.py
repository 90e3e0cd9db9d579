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


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("left", [0, 30])
def test_a_kernel_whose_kept_file_was_cut_is_compiled_again(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, left: int
) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    subprocess.run([sys.executable, tmp_path / "kernel.py"], check=True)
    (kept,) = cache.rglob(f"*.{kind}")
    os.truncate(kept, left)
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    kernel_cache.choose_cache_folder()
    assert not kept.exists()
    subprocess.run([sys.executable, tmp_path / "kernel.py"], check=True)
    assert kept.exists()
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    kernel_cache.choose_cache_folder()
    assert kept.exists(), "what is whole stays"


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


def test_a_home_that_is_full_is_named(
    cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setattr(kernel_cache, "ROOM", 2**60)
    kernel_cache.choose_cache_folder()
    assert str(cache) in capsys.readouterr().err
