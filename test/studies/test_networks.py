import dataclasses

import numpy as np
import pytest
import torch
from synthetic import synthetic_near_misses

from vpsci_ros.data.interactions import from_table
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.predictors import RepeatVelocity
from vpsci_ros.evaluation.protocols import eligible, reconstruct
from vpsci_ros.learning.config import ImitationConfig, PretrainConfig, UpdatesConfig
from vpsci_ros.policy.actor import previous
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.studies.networks import MODELS, predictor, train, untrained
from vpsci_ros.world.observation import AGENTS

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, actor_hidden=[8, 8], critic_hidden=[8, 8])
CONFIG = PretrainConfig(episodes=3, imitation=ImitationConfig(rollouts=4, rollout_steps=3))


@pytest.fixture(scope="module")
def interactions():
    return from_table(synthetic_near_misses(interactions=16, seed=3).table)


@pytest.mark.parametrize("name", MODELS.built_in)
def test_a_model_predicts_step_by_step_what_its_actors_say_of_the_whole_history(name, interactions):
    networks = train(MODELS.find(name), interactions, CONFIG, SMALL, seed=1)
    with torch.no_grad():
        for agent in AGENTS:
            networks.target_actor[agent].head[-1].weight.mul_(100.0)
    model, rows = predictor(MODELS.find(name), networks), np.arange(len(interactions))
    steps, begins = 12, rows % 3  # some rows begin later
    model.begin(len(rows))
    answers = {agent: np.zeros((len(rows), steps, 2), np.float32) for agent in AGENTS}
    for step in range(steps):
        at = np.clip(step - begins, 0, interactions.length - 1)
        active = (step >= begins) & (step - begins < interactions.length)
        seen = [interactions.observation[agent][rows, at] for agent in AGENTS]
        accelerations = model.act(*seen, interactions.curvttc[rows, at], active)
        model.executed(tuple(interactions.action[agent][rows, at] for agent in AGENTS), active)
        for agent, action in zip(AGENTS, accelerations, strict=True):
            answers[agent][rows[active], at[active]] = action[active]
    for agent in AGENTS:
        done = torch.from_numpy(interactions.action[agent][:, :steps])
        seen = torch.from_numpy(interactions.observation[agent][:, :steps])
        with torch.no_grad():
            curvttc = torch.from_numpy(interactions.curvttc[:, :steps])
            whole = networks.target_actor[agent](seen, previous(done), curvttc).numpy()
        came = interactions.present[:, :steps] & (np.arange(steps) < (steps - begins)[:, None])
        assert np.abs(whole).max() > 0.01
        np.testing.assert_allclose(answers[agent][came], whole[came], atol=1e-5)


@pytest.mark.parametrize("name", MODELS.built_in)
def test_a_model_learns_to_follow_what_it_was_shown(name, interactions):
    imitation = ImitationConfig(rollouts=8, rollout_steps=3, dropout=0.0, learning_rate=4e-3, mirror=False)
    config = PretrainConfig(episodes=60, imitation=imitation, updates=UpdatesConfig(target_update_rate=0.2))
    shown = eligible(interactions)
    model = MODELS.find(name)
    error = reconstruct(predictor(model, train(model, shown, config, SMALL, 1)), shown).ade.mean()
    control = reconstruct(RepeatVelocity(), shown).ade.mean()
    assert error < 0.9 * control


@pytest.mark.parametrize("name", MODELS.built_in)
def test_the_same_seed_learns_the_same_and_another_seed_does_not(name, interactions):
    first, again, other = (train(MODELS.find(name), interactions, CONFIG, SMALL, seed) for seed in (1, 1, 2))
    pairs = zip(first.target_actor.parameters(), again.target_actor.parameters(), strict=True)
    assert all(torch.equal(a, b) for a, b in pairs)
    assert not torch.equal(first.actor["vehicle"].head[0].weight, other.actor["vehicle"].head[0].weight)


def test_the_supervised_models_learn_the_next_velocity_alone(interactions):
    seen = []
    train(MODELS.find("lstm"), interactions, CONFIG, SMALL, 1, seen.append)
    assert [row["rollout_error"] for row in seen] == [0.0] * CONFIG.episodes
    train(MODELS.find("ma_lstm"), interactions, CONFIG, SMALL, 1, seen.append)
    assert all(row["rollout_error"] > 0.0 for row in seen[CONFIG.episodes :])


def test_only_the_layers_differ_between_models():
    parts = {}
    for name, model in MODELS.built_in.items():
        actor = untrained(model, SMALL, 1).actor["vehicle"]
        parts[name] = {key: value.shape for key, value in actor.state_dict().items() if ".layers." not in key}
    assert all(shapes == parts["ma_sst"] for shapes in parts.values())


def test_networks_without_carried_state_are_refused():
    with pytest.raises(InvalidInput, match="carry_state"):
        untrained(MODELS.find("lstm"), dataclasses.replace(SMALL, carry_state=False), 1)
