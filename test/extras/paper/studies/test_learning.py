from io import StringIO

import polars as pl
import pytest
from rich.console import Console

from vpsci_ros.extras.paper.studies.learning import WEIGHTINGS, reward_weight_study, sample_size_study
from vpsci_ros.extras.paper.studies.tables import print_table_5
from vpsci_ros.learning.training_config import (
    PretrainConfig,
    RefineConfig,
    ReplayConfig,
)
from vpsci_ros.policy.policy_config import NetworkConfig, PolicyConfig
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.world import WorldConfig, load_scenarios
from vpsci_ros.world.observation import AGENTS

SMALL = NetworkConfig(hidden=16, heads=2)
STAGE_1 = PretrainConfig(
    episodes=3,
    replay=ReplayConfig(batch_size=10),
)
EXPLORING = dict.fromkeys(AGENTS, PolicyConfig(explore=True, seed=4))
STAGE_2 = RefineConfig(replay=ReplayConfig(batch_size=40))
TWO = {name: WEIGHTINGS[name] for name in ("safety", "adaptive")}


def test_sizes_are_measured_on_the_same_clips_none_of_which_they_learn_from(tmp_path, near_misses):
    table = sample_size_study(near_misses, STAGE_1, SMALL, sizes=(4, 8, 16), seed=1, out_dir=tmp_path)
    assert table["interactions"].to_list() == ["4", "8", "16", "repeat_velocity", "fading_acceleration"]
    assert (table["vehicle_reward"].drop_nulls() < 0.0).all()
    measured = table["closed_loop_ade"].is_not_null().to_list()
    assert measured == [True, True, False, True, True], "16 are all that there are, so none is left to measure on"
    assert table["vehicle_held_out_reward"].is_not_null().to_list() == [*measured[:4], False]
    learned_from = [load_weights(tmp_path / n / "pretrained.safetensors").facts["data"] for n in ("4", "8", "16")]
    assert [data["interactions"] for data in learned_from] == [4, 8, 16]
    assert pl.read_csv(tmp_path / "table_3.csv").height == 5


def test_weightings_and_controls_are_measured_on_the_same_fresh_episodes(tmp_path, near_misses, networks):
    """Two weightings, four episodes to learn from and six to measure on."""
    world = WorldConfig(pedestrian_gain=0.5)
    table = reward_weight_study(
        near_misses,
        STAGE_2,
        networks(gain=1.0).weights({}, {}),
        SimulationConfig(load_scenarios([1]), [(1, e) for e in range(4)], 4, 4, world, policies=EXPLORING),
        learner_seed=4,
        fresh=[(1, e) for e in range(6)],
        fresh_seed=99,
        out_dir=tmp_path,
        weightings=TWO,
    )
    assert table["weights"].to_list() == [*TWO, "pretrained", "constant_velocity", "fading_acceleration"]
    assert table["vehicle_w_collision"][0] == pytest.approx(0.6)
    assert table["vehicle_w_collision"][1:].to_list() == [pytest.approx(1 / 3, abs=0.01), None, None, None]
    assert table["critical_episodes"].drop_nulls().n_unique() == 1, "hand-overs come before any policy acts"
    assert 0 < table["critical_episodes"][0] <= 6
    for name in ("collision", "goal"):
        assert (table[f"{name}_low"] <= table[f"{name}_rate"]).all()
        assert (table[f"{name}_rate"] <= table[f"{name}_high"]).all()
    assert table["reconstruction_fde"].null_count() == table["closed_loop_ade"].null_count() == 0
    assert pl.read_csv(tmp_path / "table_5.csv").height == 5
    console = Console(width=80, file=StringIO())
    print_table_5(table, console)
    printed = console.file.getvalue()
    assert "60 20 20" in printed, "the final weights, which were chosen"
    assert "…" not in printed, "no number is cut off"
    assert "33 33 33" in printed, "the adaptive ones, after four episodes"
