"""An objective of another distribution trains stage 1 by the command, and stage 2 after it."""

from pathlib import Path

import polars as pl
import pytest
from extending.page import Install, files_of
from typer.testing import CliRunner

from vpsci_ros.cli.main import app
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import RefineConfig
from vpsci_ros.learning.objectives import find_objective
from vpsci_ros.policy.weights import load_weights

CLONING = files_of("Add an objective of learning")
SMALL = ("episodes=20", "replay.batch_size=64", "hidden=16", "heads=2", "key_dimension=8")


def test_the_objective_of_the_page_learns_what_it_is_for(
    install: Install, tmp_path: Path, near_misses_file: Path
) -> None:
    install(CLONING)
    words = ["pretrain", "--params", "stage1_pretrain", "-o", str(tmp_path / "out")]
    for value in (f"near_misses=[{near_misses_file}]", "objective=cloning", *SMALL):
        words += ["--set", f"learner.{value}"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    errors = pl.read_csv(tmp_path / "out" / "log.csv")["cloning_error"]
    assert errors[-5:].mean() < errors[:5].mean()
    configuration = load_weights(tmp_path / "out" / "pretrained.safetensors").configuration
    assert configuration["PretrainConfig"]["objective"] == "cloning"


def test_it_can_be_chosen_for_stage_2(install: Install) -> None:
    install(CLONING)
    config = load("stage2_online", ["learner.objective=cloning"]).get(RefineConfig, "learner")
    assert find_objective(config.objective).refine is find_objective("ddpg").refine


def test_an_unknown_objective_is_refused_with_the_names_that_there_are(install: Install) -> None:
    install(CLONING)
    message = r"unknown objective 'clone'; expected one of ddpg, cloning, .*or install what adds it"
    with pytest.raises(InvalidInput, match=message):
        find_objective("clone")
