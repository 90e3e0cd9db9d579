"""The recipe on HEAD is the one by which the shipped weights learned: the first updates have its losses."""

import polars as pl
import pytest

from vpsci_ros.cli.options import read_sections
from vpsci_ros.cli.stages import stage_1_inputs, stage_2_inputs
from vpsci_ros.learning.online import refine
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.resources import params_dir

STAGE_1 = {"closed_loop_error": 0.27900, "vehicle_critic_loss": 3.7901, "pedestrian_critic_loss": 5.2081}
STAGE_2 = {
    "closed_loop_near": 1.43879,
    "closed_loop_off": 0.46611,
    "closed_loop_late": 0.35053,
    "closed_loop_effort": 3.46681,
    "closed_loop_error": 0.27637,
    "closed_loop_weight": 8.48966,
}


def test_the_first_updates_of_both_stages_have_the_losses_of_the_recipe(tmp_path):
    """Not their bits, which depend on the processor; a changed price, draw, limit or rule changes some loss by more."""
    sections = read_sections(params_dir() / "stage1_pretrain.yaml", ["learner.episodes=3", "learner.seed=4"])
    _, config, network, corpus, _ = stage_1_inputs(sections)
    pretrain(corpus, config, network, seed=4, out_dir=tmp_path / "1")
    first = pl.read_csv(tmp_path / "1" / "log.csv").row(-1, named=True)
    settings = [f"learner.weights={tmp_path / '1' / 'pretrained.safetensors'}", "world_simulator.episodes=2"]
    sections = read_sections(params_dir() / "stage2_online.yaml", [*settings, "learner.refresh_every=2"])
    _, config, simulation, weights, corpus, *_ = stage_2_inputs(sections)
    refine(corpus, config, weights, simulation, out_dir=tmp_path / "2")
    last = pl.read_csv(tmp_path / "2" / "refine_log.csv").row(-1, named=True)
    assert last["updates"] >= 2
    for found, expected in ((first, STAGE_1), (last, STAGE_2)):
        assert {name: found[name] for name in expected} == pytest.approx(expected, rel=5e-3)
