"""Every network may act: step by step as over the whole history, from a file of weights, and in the world."""

import dataclasses

import numpy as np
import pytest
import torch

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.policy.models import MODELS, make_actor, network_of
from vpsci_ros.policy.planners import HOLD, ContextGating, DenseGoals, Planner, Plans, chosen
from vpsci_ros.policy.social_lstm import social_pooling
from vpsci_ros.policy.stepped import SteppedActor
from vpsci_ros.policy.streaming import Draws
from vpsci_ros.policy.weights import weights_from_bytes, weights_to_bytes

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, actor_hidden=[8, 8], critic_hidden=[8, 8])
STEPPED = ("transformer", "lstm", "feedforward", "social_lstm", "multipath", "densetnt")


def weights(name, seed=0):
    torch.manual_seed(seed)
    networks = Networks(network_of(name, SMALL))
    with torch.no_grad():
        for parameter in networks.actor["vehicle"].parameters():
            parameter.add_(0.2 * torch.randn_like(parameter))
    return networks.weights({}, {})


def histories(rows=4, steps=7):
    rng = np.random.default_rng(1)
    seen = rng.normal(size=(rows, steps, 6)).astype(np.float32)
    done = rng.normal(size=(rows, steps, 2)).astype(np.float32)
    return seen, done, rng.uniform(1.0, 6.0, (rows, steps))


@pytest.mark.parametrize("name", STEPPED)
def test_a_file_of_weights_acts_step_by_step_as_its_network_says_of_the_whole_history(name):
    made = weights_from_bytes(weights_to_bytes(weights(name)))
    seen, done, curvttc = histories()
    rows, steps = curvttc.shape
    actor, begins = SteppedActor(made.actor("vehicle"), rows), np.arange(rows) % 3  # some rows begin later
    answers, every = np.zeros_like(done), np.arange(rows)
    for step in range(steps + 2):
        at, active = np.clip(step - begins, 0, steps - 1), (step >= begins) & (step - begins < steps)
        said = actor.step(seen[every, at], curvttc[every, at], step == begins, active)
        actor.executed(done[every, at], active)
        answers[every[active], at[active]] = said[active]
    network = make_actor(made.network)
    network.load_state_dict({k: torch.from_numpy(v.copy()) for k, v in made.part("vehicle_actor").items()})
    before = torch.cat([torch.zeros(rows, 1, 2), torch.from_numpy(done[:, :-1])], dim=1)
    with torch.no_grad():
        whole = network(torch.from_numpy(seen), before, torch.from_numpy(curvttc)).numpy()
    assert np.abs(whole).max() > 0.01
    np.testing.assert_allclose(answers, whole, atol=1e-5)


@pytest.mark.parametrize("temperature", [0.0, 1.0])
def test_a_plan_is_followed_with_its_deviation_until_it_is_old_or_something_else_was_done(temperature):
    made, rng = weights("multipath"), np.random.default_rng(0)
    kind = np.zeros((1, 1), np.float32)
    actor, every = SteppedActor(made.actor("vehicle"), 1), np.ones(1, bool)
    plan = None
    seen, _, _ = histories(rows=1, steps=HOLD + 3)
    for step in range(HOLD + 3):
        draws = Draws(kind, rng.normal(size=(1, 2)).astype(np.float32), np.float32(temperature))
        action = actor.step(seen[:, step], np.ones(1), np.array([step == 0]), every, draws)
        memory = actor._memories[-1].parts[0].clone()
        if step == 0:
            plan = memory
        elif step < HOLD:
            assert torch.equal(memory, plan)
            np.testing.assert_array_equal(action[0], plan[0, step].numpy())
        elif step == HOLD:
            assert not torch.equal(memory, plan)
            plan = memory
            actor.executed(action + 0.5, every)
        elif step == HOLD + 1:
            assert not torch.equal(memory, plan)


def test_plans_are_drawn_as_often_as_they_are_likely_and_the_likeliest_without_a_draw():
    actions = torch.arange(3.0)[None, :, None, None].expand(4000, 3, 30, 2)
    plans = Plans(torch.log(torch.tensor([0.2, 0.7, 0.1])).expand(4000, 3), actions, torch.zeros_like(actions))
    torch.manual_seed(0)
    drawn = chosen(plans, torch.randn(4000, 1))[:, 0, 0]
    shares = [(drawn == k).float().mean().item() for k in range(3)]
    np.testing.assert_allclose(shares, [0.2, 0.7, 0.1], atol=0.03)  # four standard errors
    assert (chosen(plans, None) == 1.0).all()


def test_a_drawn_plan_deviates_at_every_step_by_as_many_of_its_deviations_as_one_acceleration_can():
    time = 0.1 * np.arange(1, 31)
    way = 0.5 * time**2
    sigma = np.stack([0.4 * way, 0.1 + 0.3 * time], axis=1)  # [m]: forward just so, sideways as no acceleration leads
    plans = Plans(torch.zeros(3, 1), torch.randn(3, 1, 30, 2), torch.tensor(sigma).log().float().expand(3, 1, 30, 2))
    noise = torch.tensor([[1.0, 0.0], [-2.0, 0.0], [0.5, 1.0]])
    beside = (chosen(plans, None, noise) - plans.actions[:, 0]).numpy()
    nearest = np.linalg.lstsq(way[:, None], sigma, rcond=None)[0][0]  # [m/s2]
    assert nearest[0] == pytest.approx(0.4)
    np.testing.assert_allclose(beside, np.broadcast_to((noise.numpy() * nearest)[:, None], (3, 30, 2)), atol=1e-5)
    assert torch.equal(chosen(plans, None), plans.actions[:, 0])


@pytest.mark.parametrize("name", ["multipath", "densetnt"])
def test_by_the_same_latent_number_multipath_deviates_and_densetnt_whose_goals_have_no_deviation_does_not(name):
    actor, every = SteppedActor(weights(name).actor("vehicle"), 64), np.ones(64, bool)
    seen, rng = histories(rows=64, steps=1)[0][:, 0], np.random.default_rng(0)
    kind = rng.normal(size=(64, 1)).astype(np.float32)

    def acted():
        draws = Draws(kind, rng.normal(size=(64, 2)).astype(np.float32), np.float32(1.0))
        return actor.step(seen, np.ones(64), every, every, draws)

    assert np.array_equal(acted(), acted()) == (name == "densetnt")


@pytest.mark.parametrize("name", ["multipath", "social_lstm"])
def test_a_predictor_draws_other_actions_by_other_numbers_and_none_at_temperature_zero(name):
    actor = SteppedActor(weights(name).actor("vehicle"), 64)
    seen, every = histories(rows=64, steps=1)[0][:, 0], np.ones(64, bool)
    rng = np.random.default_rng(0)

    def acted(temperature):
        draws = (rng.normal(size=(64, n)).astype(np.float32) for n in (1, 2))
        return actor.step(seen, np.ones(64), every, every, Draws(*draws, np.float32(temperature)))

    assert not np.allclose(acted(1.0), acted(1.0))
    np.testing.assert_array_equal(acted(0.0), acted(0.0))


def test_residuals_that_only_an_sst_acts_with_are_refused_rather_than_left_out():
    actor, every = SteppedActor(weights("multipath").actor("vehicle"), 1), np.ones(1, bool)
    seen, _, _ = histories(rows=1, steps=1)
    with pytest.raises(InvalidInput, match="hold residuals of people, which an SST alone acts with"):
        actor.step(seen[:, 0], np.ones(1), every, every, residual=np.zeros((1, 2), np.float32))


def test_pooling_does_not_depend_on_the_order_of_the_others_and_leaves_out_who_is_far_or_absent():
    torch.manual_seed(0)
    place, hidden, order = 6.0 * torch.randn(5, 4, 2), torch.randn(5, 4, 3), torch.tensor([2, 0, 3, 1])
    present = torch.ones(5, 4, dtype=torch.bool)
    pooled = social_pooling(place, hidden, present)
    torch.testing.assert_close(social_pooling(place[:, order], hidden[:, order], present), pooled)
    # cells are 4 m wide, four along each axis: (1, -1) lies in cell (2, 1), the ninth; 8 m away is beyond the grid
    place = torch.tensor([[[1.0, -1.0], [8.5, 0.0], [1.0, -1.0]]])
    hidden = torch.tensor([[[1.0], [10.0], [100.0]]])
    pooled = social_pooling(place, hidden, torch.tensor([[True, True, False]]))
    assert pooled.flatten().nonzero().flatten().tolist() == [9]
    assert pooled[0, 9, 0] == 1.0


def test_gating_does_not_depend_on_the_order_of_the_elements():
    torch.manual_seed(0)
    gating, elements, context = ContextGating(8), torch.randn(3, 5, 8), torch.randn(3, 8)
    order = torch.tensor([4, 2, 0, 1, 3])
    gated, after = gating(elements, context)
    again, after_again = gating(elements[:, order], context)
    torch.testing.assert_close(again, gated[:, order])
    torch.testing.assert_close(after_again, after)


def test_the_goals_of_dense_plans_are_the_means_of_what_lies_nearest_to_them_and_as_likely():
    torch.manual_seed(0)
    head = DenseGoals(8)
    tracks = torch.randn(6, 2, 8)
    with torch.no_grad():
        head.score[-1].weight.mul_(20.0)  # scores that differ
        for part in head.way:
            if isinstance(part, torch.nn.Linear):
                part.weight.zero_()
                part.bias.zero_()  # the way is the constant acceleration that leads to the goal
        plans, share = head(tracks), torch.softmax(head.scores(tracks), dim=1)
    goals = plans.actions[:, :, 0] * 4.5  # a t^2 / 2 over 3 s
    np.testing.assert_allclose(plans.logits.exp().sum(dim=1), 1.0, rtol=1e-5)
    nearest = torch.cdist(head.goals.expand(6, -1, -1), goals).argmin(dim=2)
    for row in range(6):
        for k in range(6):
            own = nearest[row] == k
            mass = share[row, own].sum()
            middle = (share[row, own, None] * head.goals[own]).sum(dim=0) / mass
            torch.testing.assert_close(goals[row, k], middle, atol=0.05, rtol=0.0)  # not quite settled after ten
            torch.testing.assert_close(plans.logits[row, k].exp(), mass, atol=0.02, rtol=0.0)


def test_goals_of_which_six_are_certain_are_these_with_their_probabilities_and_an_impossible_one_stays():
    head, at = DenseGoals(8), [0, 8, 58, 60, 108, 116]
    share = torch.zeros(1, len(head.goals))
    share[0, at] = torch.tensor([0.3, 0.25, 0.2, 0.1, 0.1, 0.05])
    goals, mass = head.optimised(share)
    torch.testing.assert_close(goals[0], head.goals[at])
    torch.testing.assert_close(mass[0], share[0, at])
    alone = torch.zeros(1, len(head.goals))
    alone[0, 58] = 1.0
    goals, mass = head.optimised(alone)
    torch.testing.assert_close(goals[0, 0], head.goals[58])
    assert goals.isfinite().all()
    torch.testing.assert_close(mass[0], torch.tensor([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))


def test_encoders_that_cannot_be_are_refused():
    with pytest.raises(InvalidInput, match="unknown network 'gpt'"):
        make_actor(dataclasses.replace(SMALL, encoder="gpt"))
    with pytest.raises(InvalidInput, match="carry_state: false"):
        network_of("lstm", dataclasses.replace(SMALL, carry_state=False))
    with pytest.raises(InvalidInput, match="latent = 0: encoder multipath draws by one number"):
        make_actor(dataclasses.replace(SMALL, encoder="multipath"))
    with pytest.raises(InvalidInput, match="encoder lstm is deterministic"):
        make_actor(dataclasses.replace(SMALL, encoder="lstm", latent=2))


def test_every_built_in_network_can_be_built_and_its_weights_kept():
    for name in MODELS.built_in:
        made = weights(name)
        assert weights_from_bytes(weights_to_bytes(made)).digest() == made.digest()
    assert issubclass(MODELS.find("densetnt").actor, Planner)
