import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from vpsci_ros.data.interactions import from_table
from vpsci_ros.learning.networks import Networks
from vpsci_ros.learning.objectives import LEAST_VALUE, UNIT, Maddpg, PolicyGradient, Training
from vpsci_ros.learning.replay import Batch, History, collate, draw_recorded, recorded_histories
from vpsci_ros.learning.rewards import Scored
from vpsci_ros.learning.training_config import UpdatesConfig
from vpsci_ros.policy.actor import InwardClamp
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.road import LANE_POINTS

NO_NOISE = np.random.default_rng(0)  # drawn from by nothing where `target_noise` is 0


@pytest.fixture
def batch(near_misses):
    return collate(recorded_histories(from_table(near_misses))[:5])


def scored(batch, reward):
    action = {agent: batch.action[agent] for agent in AGENTS}
    return Scored(action, {agent: torch.full(batch.present.shape, reward) * batch.present for agent in AGENTS}, batch)


def scoring(maddpg, scored):
    """The training of these networks, whose rewards are `scored` whatever the actors do."""

    class Rewards:
        def score(self, batch, actions, rng):
            return scored

    return Training(maddpg, Rewards(), None)


def test_targets_follow_at_the_soft_update_rate(networks, batch):
    made = networks()
    maddpg = Maddpg(made, UpdatesConfig(target_update_rate=0.25, critic_learning_rate=1e-3))
    before = made.target_critic["vehicle"].state.weight.clone()
    scoring(maddpg, scored(batch, 1.0)).update_critics(batch, NO_NOISE)
    after, fast = made.target_critic["vehicle"].state.weight, made.critic["vehicle"].state.weight
    torch.testing.assert_close(after, 0.75 * before + 0.25 * fast)


def test_an_update_and_a_checkpoint_need_nothing_of_torchs_compiler(networks, batch, monkeypatch):
    """Its import takes longer than torch's own, in each process that learns."""
    monkeypatch.setitem(sys.modules, "torch._dynamo", None)  # to import it is an error
    maddpg = Maddpg(networks(), UpdatesConfig())
    scoring(maddpg, scored(batch, 1.0)).update_critics(batch, NO_NOISE)
    for optimiser in (maddpg.critic_optimiser, maddpg.actor_optimiser):
        optimiser.load_state_dict(optimiser.state_dict())


@pytest.mark.parametrize("agent", AGENTS)
def test_an_actor_sees_its_own_earlier_actions_only(networks, batch, agent):
    maddpg, changed = (Maddpg(networks(gain=20.0), UpdatesConfig()), batch.action[agent].clone())
    changed[:, 3] += 5.0
    with torch.no_grad():
        before, after = (maddpg.act(b) for b in (batch, replace(batch, action=batch.action | {agent: changed})))
    for a in AGENTS:
        moved = ((after[a] - before[a]).abs() > 1e-4).any(dim=2).any(dim=0).tolist()
        assert moved[:8] == [a == agent and step > 3 for step in range(8)]


def made_up(steps, terminal, seed):
    rng = np.random.default_rng(seed)

    def normal(rows, width):
        return {agent: rng.normal(size=(rows, width)).astype(np.float32) for agent in AGENTS}

    curvttc = rng.uniform(0.0, 8.0, steps + 1).astype(np.float32)
    road = {"lane": np.zeros((steps, 2 * LANE_POINTS), np.float32), "way": np.zeros((steps, 2), np.float32)}
    road |= {"wanted": np.zeros(2, np.float32), "rules": np.zeros(4, np.float32)}
    rest = (normal(steps, 2) for _ in range(4))
    return History(normal(steps + 1, 6), curvttc, *rest, terminal=terminal, real=False, **road)


TEMPERATURE = 0.5 * UNIT  # of (5), low enough for weights that differ


def by_algorithm_1(networks, histories, scored, agent, other, config):
    """Return delta, L with the weights (5), -J, and |Q|, as means over steps; one history after the other, unpadded."""
    critic, target, delta, value = networks.critic[agent], networks.target_critic[agent], [], []
    for k, history in enumerate(histories):
        steps = len(history)
        own, others = scored.action[agent][k, :steps], scored.action[other][k, :steps]
        seen = {}  # H(1) ... H(T + 1): O(t), A(t - 1), CurvTTC(t)
        for a in AGENTS:
            before = np.concatenate([history.came[a][:1], history.action[a]])
            seen[a] = [torch.from_numpy(x)[None] for x in (history.observation[a], before, history.curvttc)]
        q = critic.value(critic.branch(critic.encoder(*seen[agent]))[0, :-1], own, others)
        next_own, next_other = (networks.target_actor[a](*seen[a])[0] for a in (agent, other))
        next_q = target.value(target.branch(target.encoder(*seen[agent]))[0], next_own, next_other)[1:]
        if history.terminal:
            next_q = torch.cat([next_q[:-1], torch.zeros(1)])
        y = scored.reward[agent][k, :steps] / UNIT + config.discount * next_q
        delta.append(y - q)
        mine, theirs = (networks.actor[a](*seen[a])[0, :-1] for a in (agent, other))
        value.append(critic.value(critic.branch(critic.encoder(*seen[agent]))[0, :-1], mine, theirs.detach()))
    delta = torch.cat(delta)
    omega = torch.exp(UNIT * delta.detach().abs() / TEMPERATURE)
    value = torch.cat(value)
    return UNIT * delta.detach(), (omega / omega.mean() * delta**2).mean(), -value.mean(), value.detach().abs().mean()


def test_updates_follow_the_gradients_of_algorithm_1_over_the_mean_value_with_the_weights_of_equation_5(
    networks, monkeypatch
):
    """What is scored past the end of the shorter history is nothing but noise; all four actions at a step differ."""
    made, slow = networks(gain=20.0), networks(seed=1, gain=20.0)
    made.target_actor.load_state_dict(slow.actor.state_dict())
    made.target_critic.load_state_dict(slow.critic.state_dict())
    histories = [made_up(3, False, seed=0), made_up(6, True, seed=1)]
    torch.manual_seed(2)
    batch = collate(histories)
    scored = Scored({a: torch.randn(2, 6, 2) for a in AGENTS}, {a: UNIT * torch.randn(2, 6) for a in AGENTS}, batch)
    # steps of zero: gradients stay to be seen
    for clip in ("GRADIENT_CLIP", "ACTORS_CLIP"):
        monkeypatch.setattr(f"vpsci_ros.learning.objectives.{clip}", 1e9)
    config = UpdatesConfig(0.0, 0.0, discount=0.9, importance_temperature=TEMPERATURE)
    known, expected = {}, {}
    for agent, other in (AGENTS, AGENTS[::-1]):
        delta, loss, objective, size = by_algorithm_1(made, histories, scored, agent, other, config)
        assert delta.abs().max() - delta.abs().min() > TEMPERATURE  # the weights (5) differ by a factor of e
        known[agent] = (float((delta**2).mean()), UNIT * float(objective.detach()))
        for name, of in (("critic", loss), ("actor", objective / max(size, LEAST_VALUE))):
            network = getattr(made, name)[agent]
            expected[name, agent] = torch.autograd.grad(of, list(network.parameters()))
            assert max(float(gradient.abs().max()) for gradient in expected[name, agent]) > 1e-3
    maddpg = Maddpg(made, config)
    result = PolicyGradient(scoring(maddpg, scored)).update(batch, 0, NO_NOISE)
    for agent in AGENTS:
        assert (result.critic_loss[agent], result.actor_loss[agent]) == pytest.approx(known[agent], rel=1e-4)
    for (name, agent), gradients in expected.items():
        for parameter, gradient in zip(getattr(made, name)[agent].parameters(), gradients, strict=True):
            torch.testing.assert_close(parameter.grad, gradient, atol=1e-5, rtol=1e-3)


def test_recorded_steps_alone_teach_what_their_whole_windows_teach(networks, near_misses, monkeypatch):
    """Gradients of networks that encode the last step alone, and of such that encode every step of the window."""
    batch = draw_recorded(from_table(near_misses), 6, np.random.default_rng(5))
    config, learned = UpdatesConfig(0.0, 0.0), []
    for step in (Batch.step, None):
        monkeypatch.setattr(Batch, "step", step)
        maddpg = Maddpg(networks(gain=20.0), config)
        result = PolicyGradient(scoring(maddpg, scored(batch, -50.0))).update(batch, 0, NO_NOISE)
        learned.append((result, {n: p.grad for n, p in maddpg.networks.named_parameters() if p.requires_grad}))
    (alone, gradients), (whole, plain) = learned
    np.testing.assert_allclose(alone.error, whole.error, atol=1e-4)
    assert max(float(gradient.abs().max()) for gradient in plain.values()) > 1e-2
    torch.testing.assert_close(gradients, plain, atol=1e-6, rtol=1e-3)


def test_the_lesser_of_two_critics_targets_counts(networks):
    made = Networks.from_weights(networks(gain=20.0).weights({}, {}), critics=2)
    batch = collate([made_up(40, terminal=False, seed=4)])
    scored = Scored(batch.action, {a: torch.zeros(1, 40) for a in AGENTS}, batch)
    alone = Networks.from_weights(made.weights({}, {}))
    middle = Maddpg(alone, UpdatesConfig(discount=1.0)).targets(scored, NO_NOISE)["vehicle"].median()
    with torch.no_grad():  # values on both sides of zero, and a second critic whose values are the opposite
        alone.target_critic["vehicle"].head[-1].bias.sub_(middle)
        for critics, sign in zip(made.target_critics, (1.0, -1.0), strict=True):
            critics.load_state_dict(alone.target_critic.state_dict())
            critics["vehicle"].scale_values(sign)
    one = Maddpg(alone, UpdatesConfig(discount=1.0)).targets(scored, NO_NOISE)["vehicle"]
    least = Maddpg(made, UpdatesConfig(discount=1.0)).targets(scored, NO_NOISE)["vehicle"]
    assert (one < 0.0).any()
    assert (one > 0.0).any()
    torch.testing.assert_close(least, -one.abs())


def test_noise_on_target_actions_is_cut_off_at_two_deviations_and_at_the_limit(networks, monkeypatch):
    made, batch = networks(gain=20.0), collate([made_up(200, terminal=False, seed=5)])
    seen = []
    value = type(made.critic["vehicle"]).value
    monkeypatch.setattr(
        type(made.critic["vehicle"]), "value", lambda *given: (seen.append(given[2].clone()), value(*given))[1]
    )
    scored = Scored(batch.action, {a: torch.zeros(1, 200) for a in AGENTS}, batch)
    for deviation in (0.0, 0.5):
        Maddpg(made, UpdatesConfig(target_noise=deviation)).targets(scored, np.random.default_rng(6))
    plain, noisy = seen[0], seen[2]  # the vehicle's actions of both calls
    inside = plain.abs() < 4.0
    off = (noisy - plain)[inside]
    assert 0.35 < float(off.std()) < 0.55
    assert 0.99 < float(off.abs().max()) <= 1.0 + 1e-6
    assert float(noisy.abs().max()) <= 5.0


def test_the_output_beyond_the_limit_gets_the_gradient_that_leads_back_inside_alone():
    out = torch.tensor([6.0, 6.0, -6.0, -6.0, 1.0], requires_grad=True)
    clamped = InwardClamp.apply(out, 5.0)
    assert clamped.tolist() == [5.0, 5.0, -5.0, -5.0, 1.0]
    (clamped * torch.tensor([1.0, -1.0, 1.0, -1.0, 2.0])).sum().backward()  # descent moves against the gradient
    assert out.grad.tolist() == [1.0, 0.0, 0.0, -1.0, 2.0]
