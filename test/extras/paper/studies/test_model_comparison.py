import polars as pl
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.evaluation.errors import CONTROLS
from vpsci_ros.extras.paper.studies.folds import folds_by_clip
from vpsci_ros.extras.paper.studies.model_comparison import compare_models
from vpsci_ros.extras.paper.studies.model_table import Hybrid
from vpsci_ros.extras.paper.studies.table_9_page import table_9_page
from vpsci_ros.learning.training_config import PretrainConfig, RefineConfig, ReplayConfig
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.world import WorldConfig, load_scenarios

SMALL = NetworkConfig(hidden=16, heads=2)
CONFIG = PretrainConfig(episodes=2, replay=ReplayConfig(batch_size=32))
SIMULATED = ["ma_sst_ddpg", "transformer"]  # also in the hybrid setting


def clips(part):
    return set(part.select(pl.concat_str("source", "clip", separator="/")).to_series())


def test_every_clip_is_held_out_once_and_never_learned_from_in_that_fold():
    table = synthetic_near_misses(interactions=16, seed=3).table
    parts = folds_by_clip(table, 3, seed=1)
    held_out = [clips(held) for _, held in parts]
    assert set.union(*held_out) == clips(table)
    assert sum(map(len, held_out)) == len(clips(table))
    for training, held in parts:
        assert not clips(training) & clips(held)
        assert training.height + held.height == table.height
    sizes = [held["interaction"].n_unique() for _, held in parts]
    assert max(sizes) < 2 * min(sizes)
    assert folds_by_clip(table, 3, seed=1)[0][1].equals(parts[0][1])


def test_both_settings_of_a_model_stand_in_table_and_page_with_outcomes_and_what_people_do(tmp_path):
    learner = RefineConfig(replay=ReplayConfig(batch_size=32))
    world = WorldConfig(spawn="paper", episode_time=6.0)
    simulation = SimulationConfig(load_scenarios([1]), [(1, e) for e in range(6)], 6, 2, world)
    seen = Hybrid(learner, simulation, synthetic_near_misses(interactions=6, seed=4).table, [(1, 0), (1, 1)], 7)
    table = synthetic_near_misses(interactions=60, seed=3).table
    result = compare_models(table, CONFIG, SMALL, models=SIMULATED, folds=2, seed=1, out_dir=tmp_path, hybrid=seen)
    rows = result["models"]
    assert list(rows) == [*SIMULATED, *(f"{name}_refined" for name in SIMULATED), *CONTROLS]
    for name in (*SIMULATED, *(f"{name}_refined" for name in SIMULATED)):
        rate, low, high = rows[name]["world"]["collision"]
        assert 0.0 <= low <= rate <= high <= 1.0
        assert rows[name]["people"]["energy_score"] > 0.0
        value, (low, high) = rows[name]["closed_loop"]["share_of_ma_sst_ddpg"]
        assert low <= value <= high
        assert value == pytest.approx(rows[name]["closed_loop"]["ade"] / rows["ma_sst_ddpg"]["closed_loop"]["ade"])
    control = rows["constant_velocity"]["world"]  # of the two episodes once, a model's of 2 folds each
    assert {len(rows[name]["world"]["collision_by_training"]) for name in SIMULATED} == {2}
    assert all(rows[name]["world"]["critical_episodes"] == 2 * control["critical_episodes"] for name in SIMULATED)
    assert rows["fading_acceleration"]["world"]["critical_episodes"] == control["critical_episodes"]
    cells = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in table_9_page(result).splitlines()
        if line.startswith("| ") and "---" not in line
    ]
    errors = {row[0]: row for row in cells if len(row) == 10}
    people = {row[0]: row for row in cells if len(row) == 12}
    ade, (low, high) = (rows["transformer_refined"]["closed_loop"][name] for name in ("ade", "ade_interval"))
    assert errors["Transformer +"][6:8] == ["1.203", f"{ade:.3f} [{low:.3f}, {high:.3f}]"]
    assert people["no reaction (velocities kept)"][1:6] == [""] * 5, "not measured"
