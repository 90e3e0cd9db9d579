"""An objective of another distribution trains stage 1 by the command, and stage 2 after it."""

from pathlib import Path

import polars as pl
from extending.page import Install, example
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.policy.weights import load_weights

CLONING = example("cloning")
SMALL = ("episodes=20", "replay.batch_size=64", "hidden=16")


def test_the_objective_of_the_example_learns_what_it_is_for(
    install: Install, tmp_path: Path, near_misses_file: Path
) -> None:
    install(CLONING)
    words = ["pretrain", "--params", "stage1_pretrain", "-o", str(tmp_path / "out")]
    for value in (f"near_misses=[{near_misses_file}]", "objective=cloning", *SMALL):
        words += ["--set", f"learner.{value}"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    errors = pl.read_csv(tmp_path / "out" / "log.csv")["cloning_error"]
    assert errors.min() < errors[:5].mean()
    configuration = load_weights(tmp_path / "out" / "pretrained.safetensors").configuration
    assert configuration["PretrainConfig"]["objective"] == "cloning"
