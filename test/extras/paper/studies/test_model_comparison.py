import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.evaluation.errors import CONTROLS
from vpsci_ros.extras.paper.studies import trials
from vpsci_ros.extras.paper.studies.cross_validation import Refinement
from vpsci_ros.extras.paper.studies.folds import held_out_folds
from vpsci_ros.extras.paper.studies.model_comparison import compare_models
from vpsci_ros.extras.paper.studies.model_table import Hybrid
from vpsci_ros.extras.paper.studies.networks import train
from vpsci_ros.extras.paper.studies.table_9_page import table_9_page
from vpsci_ros.learning.training_config import (
    PretrainConfig,
    RefineConfig,
    ReplayConfig,
)
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.world import WorldConfig, load_scenarios

SMALL = NetworkConfig(hidden=16, heads=2)
CONFIG = PretrainConfig(episodes=2, replay=ReplayConfig(batch_size=32))
SIMULATED = ["ma_sst_ddpg", "transformer"]  # also in the hybrid setting


OPTIONS = {"models": ["lstm", "ddpg"], "folds": 2, "seed": 1}


def test_both_settings_of_a_model_stand_in_table_and_page_with_outcomes_and_what_people_do(tmp_path):
    learner = RefineConfig(replay=ReplayConfig(batch_size=32))
    world = WorldConfig(spawn="paper", episode_time=6.0)
    simulation = SimulationConfig(load_scenarios([1]), [(1, e) for e in range(6)], 6, 2, world)
    seen = Hybrid(
        Refinement(learner, simulation, 2), synthetic_near_misses(interactions=6, seed=4).table, [(1, 0), (1, 1)], 7
    )
    options = OPTIONS | {"models": SIMULATED, "seeds": 2}
    table = synthetic_near_misses(interactions=60, seed=3).table
    result = compare_models(table, CONFIG, SMALL, **options, out_dir=tmp_path, hybrid=seen)
    rows = result["models"]
    assert list(rows) == [*SIMULATED, *(f"{name}_refined" for name in SIMULATED), *CONTROLS]
    for name in (*SIMULATED, *(f"{name}_refined" for name in SIMULATED)):
        rate, low, high = rows[name]["world"]["collision"]
        assert 0.0 <= low <= rate <= high <= 1.0
        assert rows[name]["people"]["energy_score"] > 0.0
        value, (low, high) = rows[name]["closed_loop"]["share_of_ma_sst_ddpg"]
        assert low <= value <= high
        assert value == pytest.approx(rows[name]["closed_loop"]["ade"] / rows["ma_sst_ddpg"]["closed_loop"]["ade"])
    control = rows["constant_velocity"]["world"]  # of the two episodes once, a model's of 2 folds and 2 seeds each
    assert {len(rows[name]["world"]["collision_by_training"]) for name in SIMULATED} == {4}
    assert all(rows[name]["world"]["critical_episodes"] == 4 * control["critical_episodes"] for name in SIMULATED)
    first, second = (
        load_weights(tmp_path / "fold_1" / name / "weights.safetensors") for name in ("transformer", "transformer_1")
    )
    assert first.digest() != second.digest()
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


def test_each_model_learns_by_the_steps_that_did_best_on_clips_of_its_own_training(tmp_path, monkeypatch):
    table, seen = synthetic_near_misses(interactions=60, seed=3).table, []

    def train_seen(name, interactions, config, *others):
        seen.append((config, set(interactions.clip)))
        return train(name, interactions, config, *others)

    monkeypatch.setattr(trials, "train", train_seen)
    tuned = compare_models(table, CONFIG, SMALL, **OPTIONS, out_dir=tmp_path / "tuned", factors=(0.01, 100.0))
    again = compare_models(table, CONFIG, SMALL, **OPTIONS, out_dir=tmp_path / "tuned", factors=(0.01, 100.0))
    assert again["models"]["ddpg"]["trials"] == tuned["models"]["ddpg"]["trials"]
    assert len(seen) == 2 * 2 * 2, "two models, folds and factors, and none a second time"
    steps = {(c.updates.critic_learning_rate, c.updates.actor_learning_rate) for c, _ in seen}
    assert steps == {(f * 2e-4, f * 5e-4) for f in (0.01, 100.0)}
    parts, _ = held_out_folds(table, 2, 1)
    for number, (_, held_out) in enumerate(parts):
        tried = seen[4 * number : 4 * number + 4]
        assert all(clips and not clips & set(held_out.clip) for _, clips in tried)
    for name in ("lstm", "ddpg"):
        trial = tuned["models"][name]["trials"][0]
        assert trial["ade"][f"{trial['factor']:g}"] == min(trial["ade"].values())
