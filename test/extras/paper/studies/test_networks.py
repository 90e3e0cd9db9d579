import pytest
import torch
from synthetic import synthetic_near_misses

from vpsci_ros.data.interactions import from_table
from vpsci_ros.evaluation.predictors import PolicyPredictor, RepeatVelocity
from vpsci_ros.evaluation.protocols import eligible, reconstruct
from vpsci_ros.extras.paper.models import ROWS
from vpsci_ros.extras.paper.studies.networks import train, untrained
from vpsci_ros.learning.replay import collate, recorded_histories
from vpsci_ros.learning.training_config import PretrainConfig, ReplayConfig, SpeedRewardsConfig, UpdatesConfig
from vpsci_ros.policy.actor import previous
from vpsci_ros.policy.models import MODELS
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.world.observation import AGENTS

SMALL = NetworkConfig(hidden=16, heads=2)
CONFIG = PretrainConfig(episodes=3, replay=ReplayConfig(batch_size=32))
SUPERVISED = [name for name in ROWS if MODELS.find(name).learning == "supervised"]


@pytest.fixture(scope="module")
def interactions():
    return from_table(synthetic_near_misses(interactions=16, seed=3).table)


@pytest.mark.parametrize("name", SUPERVISED)
def test_a_model_learns_to_follow_what_it_was_shown(name, interactions):
    updates = UpdatesConfig(actor_learning_rate=1e-2)
    config = PretrainConfig(episodes=60, updates=updates, replay=ReplayConfig(batch_size=64))
    shown = eligible(interactions)
    learned = PolicyPredictor(train(name, shown, config, SMALL, 1).weights({}, {}))
    control = reconstruct(RepeatVelocity(), shown).ade.mean()
    assert reconstruct(learned, shown).ade.mean() < 0.9 * control


@pytest.mark.parametrize("name", ["lstm", "ddpg"])
def test_the_same_seed_learns_the_same_and_another_seed_does_not(name, interactions):
    first, again, other = (train(name, interactions, CONFIG, SMALL, seed) for seed in (1, 1, 2))
    pairs = zip(first.actor.parameters(), again.actor.parameters(), strict=True)
    assert all(torch.equal(a, b) for a, b in pairs)
    assert not torch.equal(*(next(n.actor["vehicle"].head.parameters()) for n in (first, other)))


def test_reinforcement_brings_an_actor_that_errs_nearer_to_the_recorded_speeds(interactions):
    name = "ma_ddpg"
    config = PretrainConfig(
        episodes=150,
        rewards=SpeedRewardsConfig(least_speed_deviation=0.9),
        updates=UpdatesConfig(3e-3, 5e-3, target_update_rate=0.1, discount=0.0),
        replay=ReplayConfig(batch_size=128),
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
            seen = (
                batch.observation[agent][:, :-1],
                previous(batch.action[agent], batch.came[agent]),
                batch.curvttc[:, :-1],
            )
            with torch.no_grad():
                apart = networks.actor[agent](*seen) - batch.action[agent]
            errors.append(float(apart[batch.present].abs().mean()))
        assert errors[1] < 0.7 * errors[0]
