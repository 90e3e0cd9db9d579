import dataclasses

import pytest
import torch
from synthetic import synthetic_near_misses

from vpsci_ros.data.interactions import from_table
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.predictors import PolicyPredictor, RepeatVelocity
from vpsci_ros.evaluation.protocols import eligible, reconstruct
from vpsci_ros.extras.paper.studies.networks import train, untrained
from vpsci_ros.learning.config import (
    DdpgConfig,
    ImitationConfig,
    PretrainConfig,
    ReplayConfig,
    SpeedRewardsConfig,
    UpdatesConfig,
)
from vpsci_ros.learning.replay import collate, recorded_histories
from vpsci_ros.policy.actor import previous
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.models import MODELS
from vpsci_ros.world.observation import AGENTS

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, actor_hidden=[8, 8], critic_hidden=[8, 8])
CONFIG = PretrainConfig(episodes=3, imitation=ImitationConfig(rollouts=4, rollout_steps=3))


IMITATING = [name for name, model in MODELS.built_in.items() if model.learning == "imitation"]


def predictor(networks):
    return PolicyPredictor(networks.weights({}, {}, actors="target_actor"))


@pytest.fixture(scope="module")
def interactions():
    return from_table(synthetic_near_misses(interactions=16, seed=3).table, whole_tracks=True)


@pytest.mark.parametrize("name", IMITATING)
def test_a_model_learns_to_follow_what_it_was_shown(name, interactions):
    imitation = ImitationConfig(rollouts=8, rollout_steps=3, dropout=0.0, learning_rate=4e-3, mirror=False)
    config = PretrainConfig(episodes=60, imitation=imitation, updates=UpdatesConfig(target_update_rate=0.2))
    shown = eligible(interactions)
    error = reconstruct(predictor(train(name, shown, config, SMALL, 1)), shown).ade.mean()
    control = reconstruct(RepeatVelocity(), shown).ade.mean()
    assert error < 0.9 * control


@pytest.mark.parametrize("name", ["ma_sst", "lstm", "ma_sst_ddpg", "ddpg", "multipath"])
def test_the_same_seed_learns_the_same_and_another_seed_does_not(name, interactions):
    first, again, other = (train(name, interactions, CONFIG, SMALL, seed) for seed in (1, 1, 2))
    pairs = zip(first.target_actor.parameters(), again.target_actor.parameters(), strict=True)
    assert all(torch.equal(a, b) for a, b in pairs)
    assert not torch.equal(*(next(n.actor["vehicle"].head.parameters()) for n in (first, other)))


def test_the_supervised_models_learn_the_next_velocity_alone(interactions):
    seen = []
    train("lstm", interactions, CONFIG, SMALL, 1, seen.append)
    assert [row["rollout_error"] for row in seen] == [0.0] * CONFIG.episodes
    train("ma_lstm", interactions, CONFIG, SMALL, 1, seen.append)
    assert all(row["rollout_error"] > 0.0 for row in seen[CONFIG.episodes :])


def test_only_the_layers_differ_between_models():
    parts = {}
    for name in IMITATING:
        actor = untrained(name, SMALL, 1).actor["vehicle"]
        parts[name] = {key: value.shape for key, value in actor.state_dict().items() if ".layers." not in key}
    assert all(shapes == parts["ma_sst"] for shapes in parts.values())


def test_networks_without_carried_state_are_refused():
    with pytest.raises(InvalidInput, match="carry_state"):
        untrained("lstm", dataclasses.replace(SMALL, carry_state=False), 1)


@pytest.mark.parametrize("name", ["ma_ddpg", "ddpg"])
def test_reinforcement_brings_an_actor_that_errs_nearer_to_the_recorded_speeds(name, interactions):
    config = PretrainConfig(
        episodes=150,
        rewards=SpeedRewardsConfig(exploration=1.0, least_speed_deviation=0.9),
        updates=UpdatesConfig(critic_learning_rate=5e-3, target_update_rate=0.1, discount=0.0, value_unit=10.0),
        replay=ReplayConfig(batch_size=128),
        ddpg=DdpgConfig(actor_learning_rate=3e-3, critic_head_start=50),
    )
    start = untrained(name, SMALL, 1)
    start.set_statistics(*interactions.samples(), 0.9)
    with torch.no_grad():
        for agent in AGENTS:
            start.actor[agent].head[-1].bias.fill_(2.0)  # [m/s2] an error to learn from
    learned = train(name, interactions, config, SMALL, 1, start=start.weights({}, {}))
    batch = collate(recorded_histories(interactions)[:4])
    for agent in AGENTS:
        errors = []
        for networks in (start, learned):
            seen = batch.observation[agent][:, :-1], previous(batch.action[agent]), batch.curvttc[:, :-1]
            with torch.no_grad():
                apart = networks.actor[agent](*seen) - batch.action[agent]
            errors.append(float(apart[batch.present].abs().mean()))
        assert errors[1] < 0.7 * errors[0]
