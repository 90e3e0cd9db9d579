import json
from dataclasses import replace
from types import SimpleNamespace

import pytest
from rich.console import Console
from synthetic import synthetic_near_misses

from vpsci_ros.errors import InvalidInput, Stopped
from vpsci_ros.evaluation.errors import CONTROLS, evaluate
from vpsci_ros.extras.paper.studies import model_comparison, trials
from vpsci_ros.extras.paper.studies.cross_validation import Refinement
from vpsci_ros.extras.paper.studies.folds import held_out_folds
from vpsci_ros.extras.paper.studies.model_comparison import compare_models
from vpsci_ros.extras.paper.studies.model_table import Hybrid
from vpsci_ros.extras.paper.studies.networks import train
from vpsci_ros.extras.paper.studies.table_9 import table_9_page
from vpsci_ros.extras.paper.studies.tables import print_table_9, save_table_9
from vpsci_ros.learning.config import (
    OnlineReplayConfig,
    PretrainConfig,
    RefineConfig,
    ReplayConfig,
)
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.simulation import SimulationConfig
from vpsci_ros.policy.weights import load_weights, save_weights
from vpsci_ros.world import WorldConfig, load_scenarios

pytestmark = pytest.mark.usefixtures("one_thread")

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8)
CONFIG = PretrainConfig(episodes=2, replay=ReplayConfig(batch_size=32))
RECORDED = ["sst", "lstm", "ddpg"]
SIMULATED = ["ma_sst_ddpg", "transformer"]  # also in the hybrid setting


@pytest.fixture(scope="module")
def table():
    return synthetic_near_misses(interactions=16, seed=3).table


@pytest.fixture(scope="module")
def options(table):
    return {"models": ["sst", "lstm"], "folds": 2, "seed": 1}


@pytest.fixture(scope="module")
def whole(table, options, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    result = compare_models(table, CONFIG, SMALL, **options | {"models": RECORDED}, out_dir=folder)
    assert json.loads((folder / "models.json").read_text()) == json.loads(json.dumps(result))
    return result


@pytest.fixture(scope="module")
def hybrid(table, options, tmp_path_factory):
    learner = RefineConfig(replay=OnlineReplayConfig(batch_size=32))
    world = WorldConfig(spawn="paper", episode_time=6.0)
    simulation = SimulationConfig(load_scenarios([1]), [(1, e) for e in range(6)], 6, 2, world)
    seen = Hybrid(
        Refinement(learner, simulation, 2), synthetic_near_misses(interactions=6, seed=4).table, [(1, 0), (1, 1)], 7
    )
    folder, more = tmp_path_factory.mktemp("hybrid"), synthetic_near_misses(interactions=60, seed=3).table
    return folder, compare_models(
        more, CONFIG, SMALL, **options | {"models": SIMULATED, "seeds": 2}, out_dir=folder, hybrid=seen
    )


def test_a_training_that_was_killed_before_its_cost_was_written_ends_with_it(networks, tmp_path, monkeypatch):
    folder, trained = tmp_path / "refined", []

    def refine(*_, out_dir, **__):
        trained.append(out_dir)
        save_weights(out_dir / "refined.safetensors", networks().weights({}, {}))
        if len(trained) == 1:
            raise KeyboardInterrupt  # killed at once behind the weights

    monkeypatch.setattr(model_comparison.online, "refine", refine)
    save_weights(tmp_path / "weights.safetensors", networks().weights({}, {}))
    hybrid = SimpleNamespace(
        identity=lambda: {"simulated": "1f"}, refinement=SimpleNamespace(config=RefineConfig(), simulation=None)
    )
    run = model_comparison._Run("ma_sst_ddpg", None, CONFIG, SMALL, 0, tmp_path, {})
    with pytest.raises(KeyboardInterrupt):
        run.hybrid(hybrid)
    assert run.hybrid(hybrid) == run.hybrid(hybrid) == folder / "refined.safetensors"
    assert trained == [folder] * 2
    assert json.loads((folder / "cost.json").read_text())["training_seconds"] >= 0.0


def test_every_model_is_measured_beside_the_controls_on_all_interactions(whole, table):
    assert list(whole["models"]) == [*RECORDED, *CONTROLS]
    alone = evaluate(table, {}, seed=1)
    assert whole["interactions"] == alone["interactions"]
    for name in CONTROLS:
        theirs, mine = (of["models"][name]["closed_loop"]["ade"] for of in (alone, whole))
        assert mine == pytest.approx(theirs)
    assert whole["models"]["lstm"]["parameters"] != whole["models"]["sst"]["parameters"]
    assert all(whole["models"][name]["training_seconds"] > 0.0 for name in RECORDED)


def test_both_settings_of_a_model_stand_in_the_table_with_outcomes_and_what_people_do(hybrid):
    folder, result = hybrid
    rows = result["models"]
    assert list(rows) == [*SIMULATED, *(f"{name}_refined" for name in SIMULATED), *CONTROLS]
    for name in (*SIMULATED, *(f"{name}_refined" for name in SIMULATED)):
        rate, low, high = rows[name]["world"]["collision"]
        assert 0.0 <= low <= rate <= high <= 1.0
        assert rows[name]["people"]["energy_score"] > 0.0
        value, (low, high) = rows[name]["closed_loop"]["share_of_ma_sst_ddpg"]
        assert low <= value <= high
        assert value == pytest.approx(rows[name]["closed_loop"]["ade"] / rows["ma_sst_ddpg"]["closed_loop"]["ade"])
    assert rows["ma_sst_ddpg"]["people"]["share_of_ma_sst_ddpg"] == (1.0, [1.0, 1.0])
    assert rows["ma_sst_ddpg"]["people"]["roll_outs"] == 1
    control = rows["constant_velocity"]["world"]  # of the two episodes once, a model's of 2 folds and 2 seeds each
    assert {len(rows[name]["world"]["collision_by_training"]) for name in SIMULATED} == {4}
    assert all(rows[name]["world"]["critical_episodes"] == 4 * control["critical_episodes"] for name in SIMULATED)
    first, second = (
        load_weights(folder / "fold_1" / name / "weights.safetensors") for name in ("transformer", "transformer_1")
    )
    assert first.digest() != second.digest()


def test_a_stopped_comparison_goes_on_and_keeps_what_was_trained(tmp_path, table, options, whole):
    def stop(fold, values):
        if (fold, values["episode"]) == ("2", CONFIG.episodes + 1):  # in the second model of the second fold
            raise Stopped

    options = options | {"out_dir": tmp_path}
    with pytest.raises(Stopped):
        compare_models(table, CONFIG, SMALL, **options, report=stop)
    seen = []
    result = compare_models(table, CONFIG, SMALL, **options, report=lambda fold, v: seen.append((fold, v["episode"])))
    assert seen == [("2", 3), ("2", 4)]
    for name in ("sst", "lstm"):
        for protocol in ("reconstruction", "closed_loop"):
            assert result["models"][name][protocol] == whole["models"][name][protocol]
    with pytest.raises(InvalidInput, match="a run with seed = 1, and this one has 2"):
        compare_models(table, CONFIG, SMALL, **options | {"seed": 2})


def test_each_model_learns_by_the_steps_that_did_best_on_clips_of_its_own_training(tmp_path, options, monkeypatch):
    table, seen = synthetic_near_misses(interactions=60, seed=3).table, []

    def train_seen(name, interactions, config, *others):
        seen.append((config, set(interactions.clip)))
        return train(name, interactions, config, *others)

    options = options | {"models": ["lstm", "ddpg"]}
    monkeypatch.setattr(trials, "train", train_seen)
    tuned = compare_models(table, CONFIG, SMALL, **options, out_dir=tmp_path / "tuned", factors=(0.01, 100.0))
    again = compare_models(table, CONFIG, SMALL, **options, out_dir=tmp_path / "tuned", factors=(0.01, 100.0))
    assert again["models"]["ddpg"]["trials"] == tuned["models"]["ddpg"]["trials"]
    assert len(seen) == 2 * 2 * 2, "two models, folds and factors, and none a second time"
    steps = {(c.updates.critic_learning_rate, c.updates.actor_learning_rate) for c, _ in seen}
    assert steps == {(f * 2e-4, f * 1e-4) for f in (0.01, 100.0)}
    parts, _ = held_out_folds(table, 2, 1)
    for number, (_, held_out) in enumerate(parts):
        tried = seen[4 * number : 4 * number + 4]
        assert all(clips and not clips & set(held_out.clip) for _, clips in tried)
    for name in ("lstm", "ddpg"):
        trial = tuned["models"][name]["trials"][0]
        assert trial["ade"][f"{trial['factor']:g}"] == min(trial["ade"].values())
        best = options | {"models": [name], "out_dir": tmp_path / name, "factors": [trial["factor"]]}
        compare_models(table, CONFIG, SMALL, **best)
        own, alone = (tmp_path / of / "fold_1" / name / "weights.safetensors" for of in ("tuned", name))
        assert load_weights(own).digest() == load_weights(alone).digest()


def test_an_objective_that_the_study_would_ignore_is_refused(tmp_path, table, options):
    other = replace(CONFIG, objective="single_agent_ddpg")
    with pytest.raises(InvalidInput, match=r"learner.objective = single_agent_ddpg: each model of this study has its"):
        compare_models(table, other, SMALL, **options, out_dir=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_the_page_has_every_row_with_its_intervals_and_says_what_was_not_measured_by_empty_cells(whole, hybrid):
    _, result = hybrid
    lines = table_9_page(result).splitlines()
    assert lines[0].startswith(f"{result['interactions']} interactions of {result['clips']} clips")
    assert "2 folds, 2 training(s)" in lines[0]
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in lines
        if line.startswith("| ") and "---" not in line
    ]
    assert {len(row) for row in rows} == {10, 12}
    errors = {row[0]: row for row in rows if len(row) == 10}
    people = {row[0]: row for row in rows if len(row) == 12}
    names = ["MA-SST-DDPG", "Transformer", "MA-SST-DDPG +", "Transformer +"]
    assert list(errors)[1:] == [*names, "last velocity repeated", "constant velocity, tracked"]
    assert list(people)[1:] == [*names, "no reaction (velocities kept)"]
    of = result["models"]["transformer_refined"]
    ade, (low, high) = of["closed_loop"]["ade"], of["closed_loop"]["ade_interval"]
    assert errors["Transformer +"][6:8] == ["1.203", f"{ade:.3f} [{low:.3f}, {high:.3f}]"]
    single = [round(100.0 * rate) for rate in of["world"]["collision_by_training"]]
    assert people["Transformer +"][7] == f"{min(single)} to {max(single)}%"
    assert people["no reaction (velocities kept)"][1:6] == [""] * 5
    assert people["no reaction (velocities kept)"][6].endswith("]")
    tried = {"ade": {"0.3": 0.5, "1": 0.25}, "factor": 1.0}
    some = whole | {"models": whole["models"] | {"lstm": whole["models"]["lstm"] | {"trials": [tried]}}}
    assert table_9_page(some).splitlines()[-1] == "| LSTM | 1 | 1 | 0.3: 0.500, 1: 0.250 |"
    assert "energy score" not in table_9_page({**whole, "models": {"lstm": _without_people(whole["models"]["lstm"])}})


def _without_people(of):
    return {name: value for name, value in of.items() if name != "people"}


def test_the_table_fits_eighty_columns_and_the_picture_is_one(tmp_path, whole, hybrid):
    console, both = Console(width=80, record=True), whole | {"models": whole["models"] | hybrid[1]["models"]}
    print_table_9(both, console)
    text = console.export_text()
    assert "…" not in text
    assert all(name in text for name in [*RECORDED, *SIMULATED])
    assert "ma_sst_ddpg +" in text
    assert "[1.783]" in text
    save_table_9(both, tmp_path / "models.png")
    assert (tmp_path / "models.png").read_bytes().startswith(b"\x89PNG")
