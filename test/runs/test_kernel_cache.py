"""Where compiled kernels are kept: a folder of the user's own, and damaged files in it."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from vpsci_ros.runs import kernel_cache

KERNEL = """
from vpsci_ros.safety.compiled import kernel
@kernel
def double(x):
    return 2.0 * x
assert double(1.0) == 2.0
print(sum(double.stats.cache_hits.values()))
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kernel_cache.choose_cache_folder()
    return Path(os.environ["NUMBA_CACHE_DIR"])


@pytest.mark.parametrize(
    ("suffix", "damaged"),
    [(".nbc", lambda data: data[: len(data) // 2]), (".nbc", lambda _: b""), (".nbi", lambda _: b"")],
    ids=["code is cut", "code is empty", "index is empty"],
)
def test_a_kernel_whose_cached_file_is_damaged_is_compiled_again(
    suffix: str, damaged: Callable[[bytes], bytes], cache: Path, tmp_path: Path
) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    command = [sys.executable, tmp_path / "kernel.py"]
    assert [subprocess.run(command, check=True, capture_output=True).stdout.strip() for _ in range(2)] == [b"0", b"1"]
    (file,) = cache.rglob(f"*{suffix}")
    file.write_bytes(damaged(file.read_bytes()))
    assert [subprocess.run(command, check=True, capture_output=True).stdout.strip() for _ in range(2)] == [b"0", b"1"]


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
