"""A network of another distribution is trained and measured beside the built-in ones."""

import json
from pathlib import Path

from extending.page import Install, example
from typer.testing import CliRunner

from vpsci_ros.cli.main import app

GATED = example("gated")
SMALL = ("episodes=2", "replay.batch_size=16", "hidden=16")


def test_the_example_network_is_a_row_of_table_9(install: Install, tmp_path: Path, near_misses_file: Path) -> None:
    install(GATED)
    params = Path(__file__).parents[2] / "params" / "stage1_pretrain.yaml"
    words = ["study", "models", "--params", str(params), "--models", "sst,ma_gru", "--folds", "2", "--quiet"]
    for value in (f"near_misses=[{near_misses_file}]", *SMALL):
        words += ["--set", f"learner.{value}"]
    done = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "ma_gru" in done.output
    rows = json.loads((tmp_path / "out" / "models.json").read_text(encoding="utf-8"))["models"]
    assert rows["ma_gru"]["closed_loop"]["ade"] > 0.0
    # A gated recurrent unit of width 16 has 3 * (2 * 16 * 16 + 2 * 16) = 1,632 parameters, its normalisation 32; an SST
    # layer of 8 heads has 5 * 16 * 16 + 2 * 16 + 8 + 32 = 1,352. Each of two agents has one layer.
    assert rows["ma_gru"]["parameters"] - rows["sst"]["parameters"] == 2 * (1632 + 32 - 1352)
