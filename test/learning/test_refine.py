import dataclasses

import numpy as np
import polars as pl
import pytest
import torch

from vpsci_ros.errors import InvalidInput, Stopped, VpsciError
from vpsci_ros.evaluation.held_out import HeldOut
from vpsci_ros.learning.objectives import UNIT
from vpsci_ros.learning.online import refine
from vpsci_ros.learning.refine import Refiner
from vpsci_ros.learning.replay import collate
from vpsci_ros.learning.training_config import PretrainConfig, RefineConfig
from vpsci_ros.parameters import build, values_of
from vpsci_ros.policy.actor import previous
from vpsci_ros.policy.policy_config import NetworkConfig, PolicyConfig
from vpsci_ros.policy.simulation_config import SimulationConfig
from vpsci_ros.policy.weights import load_weights, resolved
from vpsci_ros.world import WorldConfig, load_scenarios
from vpsci_ros.world.kinds import KindMixture
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.transition import TRANSITION

QUICK = build(
    RefineConfig, {"objective": "ddpg", "replay.batch_size": 40, "refresh_every": 2, "updates_per_episode": 1.0}, "test"
)


@pytest.fixture(autouse=True)
def little_real_experience(monkeypatch):
    monkeypatch.setattr("vpsci_ros.learning.refine.REAL_STEPS", 100)


def changed(config, values):
    return build(type(config), values_of(config) | values, "test")


def experience(histories=6, steps=10, seed=0, first_number=0, first_episode=0):
    rng = np.random.default_rng(seed)
    rows = np.zeros(histories * steps, TRANSITION)
    rows["number"] = first_number + np.arange(len(rows))
    rows["scenario"], rows["episode"] = 1, first_episode + np.repeat(np.arange(histories), steps)
    rows["step"], rows["acting"] = np.tile(np.arange(steps), histories), 1
    for name in ("vehicle_observation", "pedestrian_observation", "vehicle_action", "pedestrian_action"):
        rows[name] = rng.normal(size=rows[name].shape)
    rows["curvttc"] = rows["next_curvttc"] = rng.uniform(0.0, 6.0, len(rows))
    rows["last"] = rows["step"] == steps - 1
    rows["collision"] = rows["terminal"] = rows["last"] & (rows["episode"] % 2 == 0)
    return rows


@pytest.fixture
def refiner(networks, near_misses):
    return Refiner(QUICK, networks(gain=1.0).weights({}, {}), near_misses, seed=4)


def test_a_transition_that_is_not_a_number_is_counted_and_leaves_weights_and_returns_finite(refiner):
    rows = experience()
    rows["vehicle_observation"][3, 0] = np.nan
    refiner.add(rows)
    while refiner.due:
        refiner.update()
    summary = refiner.summary()
    assert summary["refused"] == 1
    assert all(np.isfinite(value) for value in summary.values())
    assert np.isfinite(refiner.final().facts["learned"]["reward_weights"]).all()


def test_weights_are_not_written_where_what_was_learned_is_not_finite(tmp_path, networks, near_misses):
    refiner = Refiner(QUICK, networks(gain=1.0).weights({}, {}), near_misses, seed=4, out_dir=tmp_path)
    refiner.reward_weights.values = np.array([[np.nan, 0.5, 0.5]] * 2)
    with pytest.raises(VpsciError, match="expected finite values, got vehicle_w_collision = nan"):
        refiner.save()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("each", [0.5, 1.0, 3.0])
def test_so_many_updates_are_due_for_every_episode_once_there_is_a_batch(networks, near_misses, each):
    config = changed(QUICK, {"updates_per_episode": each})
    refiner = Refiner(config, networks(gain=1.0).weights({}, {}), near_misses, seed=4)
    rows = experience(histories=6)
    refiner.add(rows[:39])
    assert not refiner.due
    refiner.add(rows[39:-1])  # the last one is not whole
    refiner.add(experience(histories=2, first_number=59, first_episode=6))
    shares = []
    while refiner.due:
        shares.append(refiner.update()["real_share"])
    assert len(shares) == int(7 * each)
    assert 0.0 < sum(shares) < len(shares)
    assert refiner.progress.received == 79
    assert refiner.assembler.lost == 0


def mean_value(learner):
    """Return the vehicle's mean Q over its real histories, times the unit of values."""
    networks = learner._networks
    batch = collate(learner._buffer.histories)
    seen = (
        batch.observation["vehicle"][:, :-1],
        previous(batch.action["vehicle"], batch.came["vehicle"]),
        batch.curvttc[:, :-1],
    )
    critic = networks.target_critic["vehicle"]
    q = critic.value(critic.branch(critic.encoder(*seen)), batch.action["vehicle"], batch.action["pedestrian"])
    return float(q[batch.present].mean().detach()) * UNIT


@pytest.mark.parametrize(("scaling", "factor"), [(20.0, 0.2)])
def test_values_of_stage_1_mean_the_same_return_in_stage_2(networks, near_misses, scaling, factor):
    """Stage 1 has rewards of 100 R_v; stage 2 has w_3 = 0.25 times `scaling`."""
    start = networks().weights(resolved(PretrainConfig()), {})
    config = changed(QUICK, {"rewards.speed_scaling": scaling, "rewards.weights": [0.5, 0.25, 0.25]})
    learner = Refiner(config, start, near_misses, seed=4)
    after_stage_2 = networks().weights(resolved(PretrainConfig(), config), {})
    unconverted = mean_value(Refiner(config, after_stage_2, near_misses, seed=4))
    assert abs(unconverted) > 0.01
    assert mean_value(learner) == pytest.approx(0.25 * factor * unconverted, rel=1e-4)


def test_what_is_kept_is_the_running_mean_of_the_actors_that_acted_with_errors_of_its_own(
    tmp_path, networks, near_misses, monkeypatch
):
    """Memory of two refreshes: the mean of a, b, c and d is (a + b) / 8 + c / 4 + d / 2; d has the last update."""
    monkeypatch.setattr("vpsci_ros.learning.refine.MEAN_REFRESHES", 2)
    config = changed(QUICK, {"updates.actor_learning_rate": 0.001})
    refiner = Refiner(config, networks(gain=1.0).weights({}, {}), near_misses, seed=4, out_dir=tmp_path)
    refiner.add(experience(histories=7))
    acted, name = [], "vehicle_actor.head.4.weight"
    while refiner.due:
        refiner.update()
        if refiner.take_refresh():
            acted.append(refiner.acting().tensors[name])
    assert refiner.progress.updates == 7
    kept = refiner.save()
    a, b, c, d = *acted, refiner.acting().tensors[name]
    np.testing.assert_allclose(kept.tensors[name], (a + b) / 8 + c / 4 + d / 2, rtol=1e-5)
    assert min(np.abs(each - kept.tensors[name]).max() for each in (b, c, d)) > 1e-4
    assert load_weights(tmp_path / "refined.safetensors").digest() == kept.digest()
    held_out = pl.concat_str("source", "clip", separator="/").is_in(kept.facts["data"]["held_out_clips"])
    assert kept.facts["held_out"]["errors"] == HeldOut(near_misses.filter(held_out)).errors(kept)


@pytest.mark.parametrize(
    ("world", "message"),
    [
        ({"vehicle_driver": "autopilot"}, "vehicle_driver = autopilot: stage 2 expects policy"),
        ({"pedestrians": 3}, "world_simulator.pedestrians = 3: stage 2 expects 1$"),
        ({"kinds": KindMixture(older=0.5)}, "world_simulator.kinds: stage 2 learns from adults"),
    ],
)
def test_a_world_from_which_it_cannot_learn_is_refused_by_name(tmp_path, networks, near_misses, world, message):
    simulation = SimulationConfig(load_scenarios([1]), [(1, 0)], 1, 3, WorldConfig(**world))
    with pytest.raises(InvalidInput, match=message):
        refine(near_misses, QUICK, networks().weights({}, {}), simulation, out_dir=tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_a_machine_with_more_cores_learns_the_same_bits_and_has_its_threads_back(networks, near_misses):
    """Products of 128 columns, as Table 8 has them, are shared between threads where torch may have several."""
    learned, before = [], torch.get_num_threads()
    for threads in (1, 2):
        torch.set_num_threads(threads)
        learner = Refiner(QUICK, networks(NetworkConfig(), gain=1.0).weights({}, {}), near_misses, seed=4)
        learner.add(experience())
        while learner.due:
            learner.update()
        learned.append(learner.weights())
        assert torch.get_num_threads() == threads
    torch.set_num_threads(before)
    assert learned[0] == learned[1]


def test_learning_ends_where_the_gradient_has_vanished_for_long(refiner):
    def learn_from(first, count):
        for i in range(first, first + count):
            refiner.progress.updates += 1  # as if each had paid for one
            refiner.add(experience(histories=1, first_number=10 * i, first_episode=i))

    refiner.progress.norm = 1e-5
    learn_from(0, 99)
    assert not refiner.finished
    learn_from(99, 1)
    assert refiner.finished


def test_stage_2_in_process_runs_stops_and_goes_on_to_the_same_result(tmp_path, networks, near_misses, monkeypatch):
    start = networks(gain=1.0).weights({}, {})
    exploring = dict.fromkeys(AGENTS, PolicyConfig(explore=True, seed=3))
    episodes = [(s, e) for e in range(4) for s in (1, 6)]
    simulation = SimulationConfig(load_scenarios([1, 6]), episodes, batch=1, seed=3, policies=exploring)

    def run(folder, report=None):
        return refine(near_misses, QUICK, start, simulation, out_dir=tmp_path / folder, report=report)

    def stop(values):
        raise Stopped

    measured, errors = [], HeldOut.errors
    monkeypatch.setattr(HeldOut, "errors", lambda *known: measured.append(known) or errors(*known))
    whole = run("whole")
    refreshes = pl.read_csv(tmp_path / "whole" / "refine_log.csv")["refreshes"][-1]
    assert len(measured) in (1 + refreshes, 2 + refreshes), "stage 1's and each refresh's errors, each once"
    with pytest.raises(Stopped):
        run("parts", stop)
    resumed = run("parts")
    assert all(np.array_equal(whole.tensors[name], resumed.tensors[name]) for name in whole.tensors)
    assert load_weights(tmp_path / "whole" / "refined.safetensors").facts["learned"]["updates"] > 3
    log = (tmp_path / "whole" / "refine_log.csv").read_text().splitlines()
    assert len(log) == 3
    assert {"collision_rate", "validation_collision_rate"} < set(log[0].split(","))


def test_a_checkpoint_of_another_simulation_is_refused(tmp_path, networks, near_misses):
    start = networks(gain=1.0).weights({}, {})

    def stop(values):
        raise Stopped

    simulation = SimulationConfig(load_scenarios([1]), [(1, e) for e in range(8)], batch=1, seed=3)
    with pytest.raises(Stopped):
        refine(near_misses, QUICK, start, simulation, out_dir=tmp_path, report=stop)
    before = (tmp_path / "refine_checkpoint.safetensors").read_bytes()
    others = [
        (dataclasses.replace(simulation, seed=4), "simulation.seed = 3"),
        (dataclasses.replace(simulation, scenarios=load_scenarios([6])), "simulation.scenarios"),
        (dataclasses.replace(simulation, policies={"vehicle": PolicyConfig(explore=True)}), "simulation.policies"),
    ]
    for other, message in others:
        with pytest.raises(InvalidInput, match=message):
            refine(near_misses, QUICK, start, other, learner_seed=3, out_dir=tmp_path)
    assert (tmp_path / "refine_checkpoint.safetensors").read_bytes() == before
