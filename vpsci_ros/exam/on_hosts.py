"""Runs of an exam on the hosts of a Ray cluster: each in a folder of its host, brought here whole, and read here.

A host needs the same vpsci_ros, and the driving system where this machine has it: at the same path, or installed. Files
are compared by hash, so that no host drives something else.
"""

import io
import platform
import tarfile
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vpsci_ros.errors import VpsciError
from vpsci_ros.exam.class_process import files_of_class
from vpsci_ros.exam.config import EXTERNAL, PERSON, ExamConfig
from vpsci_ros.exam.exam import Exam
from vpsci_ros.exam.process import command_of, files_of
from vpsci_ros.resources import near_misses_path
from vpsci_ros.runs.files import sha256

_PARTS = ("runs", "logs")


def driver_files(config: ExamConfig) -> dict[str, str]:
    """Return the files of the driving system, each with its SHA-256.

    :raises InvalidInput: there is no such program or class.
    """
    if config.ads_class:
        return files_of_class(config.ads_class)
    if config.ads in (EXTERNAL, PERSON):
        return {}
    command_of(config.ads)
    return files_of(config.ads)


def files_needed(exam: Exam) -> dict[str, str]:
    """Return the files that a run reads and no parameter holds, each with its SHA-256."""
    recorded = [near_misses_path(exam.config.recorded)] if exam.config.recorded else []
    return driver_files(exam.config) | {path.name: sha256(path) for path in (exam.weights, *recorded)}


def elsewhere(
    conductor: Callable[[Path], Callable[[Any], object]], exam: Exam, needed: dict[str, str]
) -> Callable[[Any], bytes]:
    """Return what drives runs in a folder of this host, each to the files that it leaves.

    :param conductor: returns what conducts a run in a folder.
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

    def drive(run: Any) -> bytes:
        with tempfile.TemporaryDirectory(prefix="vpsci-exam-") as folder:
            conductor(Path(folder))(run)
            return _packed(Path(folder))

    return drive


def _packed(folder: Path) -> bytes:
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
                path.rename(folder / part / path.name)
