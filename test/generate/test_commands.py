"""The commands as a user types them: generate, info, verify."""

import re
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.documents import dump_yaml
from vpsci_ros.errors import VpsciError
from vpsci_ros.report.summary import print_info


@pytest.fixture
def params(sections, tmp_path: Path) -> Path:
    path = tmp_path / "params.yaml"
    path.write_text(dump_yaml({name: {"ros__parameters": values} for name, values in sections.values.items()}))
    return path


def run(*arguments: object) -> str:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_generate_then_info_then_verify(params, tmp_path) -> None:
    out = tmp_path / "out"
    command = ("generate", "--params", params, "-o", out, "--scenarios", "6", "--episodes", "3", "--workers", "1")
    assert re.search(r"3 episodes kept; written: .* kept an hour; the paper's .* kept 244", run(*command), re.DOTALL)
    assert "simulated" not in run(*command).replace("simulated_", "")  # complete already
    assert re.search(r"B N-S +3 +24,702 ", run("dataset", "info", out))
    assert "rows the same to the bit, hashes right" in run("dataset", "verify", out, "--workers", "1")
    (out / "LocationB_PedCross_N-S.parquet").unlink()
    with pytest.raises(VpsciError, match="1 of its files are not as simulated"):
        run("dataset", "verify", out, "--workers", "1")


def test_info_fits_a_terminal(made, capsys) -> None:
    print_info(made, Console())
    output = capsys.readouterr().out
    assert "…" not in output
    assert re.search(r"\ball +24 +198,157 ", output)
