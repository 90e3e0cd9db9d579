"""One page of all the paper's figures and tables: what is given is drawn, what is not is named with its command."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from extras.paper.turing.raters import simulated
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.extras.paper.studies.paper import CAPTIONS
from vpsci_ros.extras.paper.turing.result_page import write_result


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders as stage 2, the study of Table 3, and the Turing test leave them."""
    folder = tmp_path_factory.mktemp("runs")
    for name in ("refine", "samples"):
        (folder / name).mkdir()
    rewards = {"episode": range(40), "vehicle": np.linspace(-9.0, -2.0, 40), "pedestrian": np.linspace(-9.0, -4.0, 40)}
    pl.DataFrame(rewards).write_csv(folder / "refine/refine_episodes.csv")
    row = {"interactions": "50", "vehicle_reward": -1.5, "pedestrian_reward": -2.5, "vehicle_critic_loss": 0.4}
    pl.DataFrame([row, dict.fromkeys(row) | {"interactions": "repeat_velocity"}]).write_csv(
        folder / "samples/table_3.csv"
    )
    write_result(simulated(np.random.default_rng(1), 12, 4), folder / "turing")
    return [folder / name for name in ("refine", "samples", "turing")]


def study(dataset: Path, output: Path, *more: object) -> tuple[str, str]:
    """Return what the command prints, and the page."""
    result = CliRunner().invoke(app, ["study", "paper", str(dataset), "-o", str(output), *map(str, more)])
    assert result.exit_code == 0, result.output
    return result.output, (output / "paper.html").read_text(encoding="utf-8")


def test_everything_that_is_given_is_drawn(
    dataset: Path, near_misses_file: Path, runs: list[Path], tmp_path: Path
) -> None:
    given = [word for run in runs for word in ("--run", run)]
    said, page = study(dataset, tmp_path / "out", "--near-misses", near_misses_file, "--rules", dataset, *given)
    assert "not given: table 9 (vpsci study models)" in said
    assert said.count("not given") == 1
    for name in CAPTIONS:
        assert (tmp_path / f"out/{name}.png").read_bytes().startswith(b"\x89PNG"), name
    assert page.count("data:image/png;base64,") == len(CAPTIONS)
    assert "<td>50<td>-1.50<td>-6.83" in page, "Table 3 beside the paper's"
    assert "LocationA_PedCross_S-N<td>4<td>20,066" in page, "Table 10 beside the paper's"
    assert "<td>-13.5<td>" in page, "Table 11 beside the paper's"
    assert json.loads((tmp_path / "out/paper.json").read_text())["table_3"][0]["vehicle_reward"] == -1.5


def test_what_is_not_given_is_named_and_a_folder_of_nothing_refused(
    dataset: Path, near_misses_file: Path, tmp_path: Path
) -> None:
    said, page = study(dataset, tmp_path / "out", "--near-misses", near_misses_file)
    assert "not given: figure 6 (vpsci refine)" in said
    assert "rule-based pair in figures 11 to 13: <code>--rules DIR</code>" in page
    assert not (tmp_path / "out/figure_10.png").exists()
    result = CliRunner().invoke(
        app, ["study", "paper", str(dataset), "-o", str(tmp_path / "x"), "--run", str(tmp_path)]
    )
    assert "expected the folder of a finished run" in str(result.exception)
