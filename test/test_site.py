"""The documentation site: it builds without a warning, its rooms are those of the imports, and its tutorial runs."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import nbclient
import nbformat
import pytest

from vpsci_ros.nodes.domain import own_domain

ROOT = Path(__file__).resolve().parents[1]


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", tmp_path / "site"]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=280)
    assert built.returncode == 0, built.stderr[-4000:]
    assert "curvature_from_positions" in (tmp_path / "site/api/safety.html").read_text("utf-8")
    assert "vpsci generate" in (tmp_path / "site/commands.html").read_text("utf-8")
    assert "ma_sst_ddpg" in (tmp_path / "site/model_card.html").read_text("utf-8")


def test_the_table_of_rooms_is_that_of_the_imports(tool: Callable[[str], ModuleType]) -> None:
    architecture = tool("architecture")
    assert architecture.in_page() == architecture.written(), "python tools/architecture.py writes it"


@pytest.mark.timeout(900)  # it compiles kernels, trains, generates and examines, beside other tests
def test_the_tutorial_runs_from_its_first_cell_to_its_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each cell of the shell fails the notebook where its command fails (%%bash does, `!` would not)."""
    monkeypatch.setenv("PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    book = nbformat.read(ROOT / "docs" / "tutorial.ipynb", 4)
    assert not any(cell.source.startswith("!") for cell in book.cells)
    with own_domain():
        nbclient.NotebookClient(book, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert (tmp_path / "stage1/pretrained.safetensors").is_file()
    assert (tmp_path / "page.html").stat().st_size > 100_000
