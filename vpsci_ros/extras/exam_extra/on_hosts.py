"""Runs of an exam on the hosts of a Ray cluster: each in a folder of its host, brought here whole, and read here.

A host needs the same vpsci_ros, and the driving system where this machine has it: at the same path, or installed. Files
are compared by hash, so that no host drives something else.
"""

import io
import platform
import shutil
import tarfile
import tempfile
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from vpsci_ros.errors import VpsciError
from vpsci_ros.exam.collect import is_done, read_run
from vpsci_ros.exam.conduct import Conductor, Crew, Run
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.measures import RunResult
from vpsci_ros.exam.prepare import driver_files
from vpsci_ros.resources import near_misses_path
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.ray_workers import RayWorkers

_PARTS = ("runs", "logs")


def hosts_crew(exam: Exam, address: str) -> Crew:
    """Return who does the runs of an exam on the hosts of the cluster at this address."""

    def crew(here: Conductor, folder: Path, workers: int | None) -> Hosts:
        return Hosts(
            exam.parts(), folder, RayWorkers(partial(elsewhere, here, exam, files_needed(exam)), address, workers)
        )

    return crew


class Hosts:
    """Workers on other hosts, of an exam's parts; a run that is done in the folder is only read."""

    here = False

    def __init__(self, parts: Sequence[Exam], folder: Path, workers: RayWorkers[Run, bytes]) -> None:
        self._parts, self._folder, self._workers = parts, folder, workers
        self._done: deque[Run] = deque()
        self.size = workers.size

    def submit(self, unit: Run) -> None:
        """Have a run done, or read where it is done."""
        if is_done(self._parts[unit.part], self._folder, unit.pedestrian):
            self._done.append(unit)
        else:
            self._workers.submit(unit)

    def collect(self) -> list[tuple[Run, RunResult]]:
        """Wait for a run and return its result."""
        if self._done:
            unit = self._done.popleft()
            return [(unit, self._read(unit))]
        found = self._workers.collect()
        for _, files in found:
            unpack(files, self._folder)
        return [(unit, self._read(unit)) for unit, _ in found]

    def _read(self, unit: Run) -> RunResult:
        return read_run(self._parts[unit.part], self._folder, unit.pedestrian)

    def close(self) -> None:
        """Stop at once."""
        self._workers.close()


def files_needed(exam: Exam) -> dict[str, str]:
    """Return the files that a run reads and no parameter holds, each with its SHA-256."""
    recorded = [near_misses_path(exam.config.recorded)] if exam.config.recorded else []
    return driver_files(exam.config) | {path.name: sha256(path) for path in (exam.weights, *recorded)}


def elsewhere(here: Conductor, exam: Exam, needed: dict[str, str]) -> Callable[[Run], bytes]:
    """Return what drives runs in a folder of this host, each to the files that it leaves.

    :param needed: `files_needed` where the exam was requested.
    :raises VpsciError: this host has other files.
    """
    own = files_needed(exam)
    if own != needed:
        other = sorted(name for name in own.keys() | needed.keys() if own.get(name) != needed.get(name))
        raise VpsciError(
            f"host {platform.node()} of the cluster has other files than the machine of the exam: {', '.join(other)}; "
            "install the same driving system and weights on every host"
        )

    def drive(run: Run) -> bytes:
        with tempfile.TemporaryDirectory(prefix="vpsci-exam-") as folder:
            here(Path(folder))(run)
            return packed(Path(folder))

    return drive


def packed(folder: Path) -> bytes:
    """Return the files of a run as a tar archive."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz", compresslevel=1) as archive:
        for part in _PARTS:
            archive.add(folder / part, part)
    return out.getvalue()


def unpack(files: bytes, folder: Path) -> None:
    """Put the files of a run where it would have left them; what marks it as done comes last."""
    with tempfile.TemporaryDirectory(prefix=".arriving-", dir=folder) as beside:
        with tarfile.open(fileobj=io.BytesIO(files)) as archive:
            archive.extractall(beside, filter="data")
        for part in reversed(_PARTS):
            (folder / part).mkdir(exist_ok=True)
            for path in sorted((Path(beside) / part).iterdir()):
                there = folder / part / path.name
                if there.is_dir():
                    shutil.rmtree(there)  # of a run that failed before
                path.rename(there)
