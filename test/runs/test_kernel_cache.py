"""Where compiled kernels are kept: a folder of the user's own, and damaged files in it."""

import importlib.util
import os
from collections.abc import Callable
from pathlib import Path

import numba
import pytest

from vpsci_ros.runs import kernel_cache

KERNEL = """
from vpsci_ros.safety.compiled import kernel
@kernel
def double(x):
    return 2.0 * x
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")  # put back after the test
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")  # put back after the test
    kernel_cache.choose_cache_folder()
    return Path(os.environ["NUMBA_CACHE_DIR"])


def loaded_from_the_cache(path: Path) -> bool:
    """Import a module with a kernel as a new process does, and call it; return whether it was not compiled for it."""
    spec = importlib.util.spec_from_file_location("kernel", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.double(1.5) == 3.0
    return sum(module.double.from_python.stats.cache_hits.values()) == 1


@pytest.mark.parametrize(
    ("suffix", "damaged"),
    [
        (".nbc", lambda data: data[: len(data) // 2]),
        (".nbc", lambda data: data.replace(b"BC\xc0\xde", b"BC\xc0\xdf")),
        (".nbi", lambda data: b""),
    ],
    ids=["code is cut", "code is no LLVM bitcode", "index is empty"],
)
def test_a_kernel_whose_cached_file_is_damaged_is_compiled_again(
    suffix: str, damaged: Callable[[bytes], bytes], cache: Path, tmp_path: Path
) -> None:
    path = tmp_path / "kernel.py"
    path.write_text(KERNEL)
    assert not loaded_from_the_cache(path)
    assert loaded_from_the_cache(path)
    (file,) = cache.rglob(f"*{suffix}")
    whole = file.read_bytes()
    file.write_bytes(damaged(whole))
    assert file.read_bytes() != whole
    assert not loaded_from_the_cache(path)
    assert loaded_from_the_cache(path)


def test_only_the_user_may_write_what_is_loaded_and_anothers_folder_is_not_used(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "vpsci_ros").chmod(0o777)
    for user, used in ((os.getuid(), True), (os.getuid() + 1, False)):
        monkeypatch.setenv("NUMBA_CACHE_DIR", "")
        monkeypatch.setattr(os, "getuid", lambda user=user: user)
        kernel_cache.choose_cache_folder()
        assert bool(os.environ["NUMBA_CACHE_DIR"]) == used
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
        assert (tmp_path / "vpsci_ros").stat().st_mode & 0o777 == 0o700
