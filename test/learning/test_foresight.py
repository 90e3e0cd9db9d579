import numpy as np
import pytest
import torch

from vpsci_ros.learning.foresight import (
    BRAKING,
    draw_moments,
    draw_scripted,
    foresee,
    moments_at,
    remembered,
    step_along,
)
from vpsci_ros.learning.replay import History
from vpsci_ros.learning.rewards import AHEAD, clearance
from vpsci_ros.learning.transitions import TransitionBuilder
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance_pair
from vpsci_ros.world import World, WorldConfig, load_scenario
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.observation import AGENTS, LANE_GRID, LANE_NODES
from vpsci_ros.world.tick import Actions


def meeting(distance, speed, walking, steps=6, collision=False):
    """A vehicle that drives straight on, and a pedestrian `distance` ahead who walks with `walking` (forward, left)."""
    seen = {agent: np.zeros((steps + 1, 6), np.float32) for agent in AGENTS}
    for k in range(steps + 1):
        apart = np.array(distance) + 0.1 * k * (np.array(walking) - [speed, 0.0])
        relative = np.array([speed, 0.0]) - walking
        seen["vehicle"][k] = [speed, 0.0, *-apart, *relative]
        seen["pedestrian"][k] = [*walking, *apart, *-relative]
    events = np.zeros((steps, 2), np.float32)
    events[-1, 0] = -200.0 * collision
    return History(
        seen,
        np.full(steps + 1, 3.0, np.float32),
        {agent: np.zeros((steps, 2), np.float32) for agent in AGENTS},
        {agent: np.zeros((steps, 2), np.float32) for agent in AGENTS},
        dict.fromkeys(AGENTS, events),
        terminal=False,
        real=False,
        lane=np.zeros((steps, LANE_NODES), np.float32),
    )


def lost(networks, histories, at, steps=20, anticipation=0.0, pace=(0.5, 0.5), **more):
    start = moments_at(histories, np.array(at))
    options = {"steps": steps, "anticipation": anticipation, "pace": pace, "gain": 0.5}
    return foresee(networks.actor, start, **options, **more)


def test_clearance_is_the_worlds_for_footprints_apart_and_never_positive_where_they_touch():
    rng = np.random.default_rng(0)
    x, y, heading, px, py = rng.uniform(-4.0, 4.0, (5, 300))
    vehicle, pedestrian = torch.tensor(np.stack([x, y], 1)), torch.tensor(np.stack([px, py], 1))
    mine = clearance(vehicle, torch.tensor(heading), pedestrian).numpy()
    size = VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS
    true = np.array([clearance_pair(*row, *size) for row in np.stack([x, y, heading, px, py], 1)])
    apart = true > 0.0
    assert apart.sum() > 50
    assert (~apart).sum() > 50
    assert mine[apart] == pytest.approx(true[apart], abs=1e-3)
    assert mine[~apart].max() < 1e-3


def test_agents_that_keep_their_speeds_lose_by_collision_exactly_where_they_meet(networks):
    still = networks(gain=0.0)  # actors that answer zero
    ahead, beside = meeting([10.0, 0.0], 4.0, [0.0, 0.0]), meeting([10.0, 6.0], 4.0, [0.0, 0.0])
    assert float(lost(still, [ahead], [0])[0].detach()) > 0.1
    assert float(lost(still, [beside], [0])[0].detach()) == 0.0


def test_another_speed_than_ones_pace_costs_the_square_of_the_share(networks):
    history = meeting([60.0, 9.0], 7.0, [0.0, 2.0])
    history.observation["vehicle"][3, 0], history.observation["pedestrian"][3] = 3.5, [0, 1.0, 60, 9, -3.5, 1.0]
    vehicle, pedestrian = (1.0 - 3.5 / 7.0) ** 2, (1.0 - 1.0 / 2.0) ** 2
    goal = lost(networks(gain=0.0), [history], [3])[1]
    assert float(goal.detach()) == pytest.approx(0.5 * (vehicle + pedestrian), rel=1e-5)
    goal = lost(networks(gain=0.0), [history], [3], pace=(0.2, 0.9))[1]
    assert float(goal.detach()) == pytest.approx(0.2 * vehicle + 0.9 * pedestrian, rel=1e-5)


def test_a_pedestrian_who_has_stopped_or_turned_aside_loses_by_the_velocity_of_the_hand_over(networks):
    history = meeting([60.0, 9.0], 7.0, [0.0, 2.0])
    after = (2, [0.0, 0.0], 1.0), (3, [1.5, 0.0], 1.5625), (4, [0.5, 1.0], 0.3125), (5, [0.0, 2.0], 0.0)
    for step, walking, missed in after:
        history.observation["pedestrian"][step] = [*walking, 60.0, 9.0, walking[0] - 7.0, walking[1]]
        goal = lost(networks(gain=0.0), [history], [step], pace=(0.0, 1.0))[1]
        assert float(goal.detach()) == pytest.approx(missed, abs=1e-5)


def test_the_course_of_the_hand_over_stays_where_it_was_while_the_vehicle_turns():
    """0.4 m a step round a bend of 0.1 rad/m: the heading has turned left by 0.2 rad after five steps."""
    history = meeting([20.0, 4.0], 4.0, [0.0, 1.0])
    history.lane[:] = 0.1 * LANE_GRID * np.arange(LANE_NODES)
    start = moments_at([history, history], np.array([0, 5]))
    assert start.course.numpy() == pytest.approx(np.array([[0.0, 1.0], [np.sin(0.2), np.cos(0.2)]]), abs=1e-5)


def regardless(agent, acceleration, sideways=False):
    """What `foresee` takes for one roll-out in which `agent` accelerates by so much whatever its policy says."""
    return {agent: torch.tensor([0.0, acceleration] if sideways else [acceleration, 0.0]).expand(1, 60, -1)}


def test_a_vehicle_that_brakes_whatever_its_policy_says_stands_after_its_braking_distance(networks):
    """4 m/s are gone after 2 s and 4 m at 2 m/s2; a car that is driven on at 4 m/s reaches those who stand further."""
    driven, reach = networks(gain=0.0), 0.5 * VEHICLE_LENGTH + PEDESTRIAN_RADIUS + 0.5
    near, far = meeting([3.9 + reach, 0.0], 4.0, [0.0, 0.0]), meeting([4.1 + reach, 0.0], 4.0, [0.0, 0.0])

    def collision(history, acceleration):
        scripted = regardless("vehicle", acceleration)
        return float(lost(driven, [history], [0], steps=50, scripted=scripted)[0].detach())

    assert collision(near, -2.0) > 0.0
    assert collision(far, -2.0) == 0.0
    assert collision(far, float("nan")) > 0.0


@pytest.mark.parametrize(("agent", "pace"), [("vehicle", (1.0, 0.0)), ("pedestrian", (0.0, 1.0))])
def test_speeding_costs_as_much_as_a_delay(networks, agent, pace):
    """Half of a pedestrian's acceleration becomes motion; the first step is taken at the speed of the hand-over."""
    net, history = networks(gain=0.0), meeting([60.0, 0.0], 4.0, [0.0, 2.0])
    before, gained = (4.0, 0.1) if agent == "vehicle" else (2.0, 0.05)

    def goal(acceleration):
        scripted = regardless(agent, acceleration, sideways=agent == "pedestrian")
        return float(lost(net, [history], [0], steps=10, pace=pace, scripted=scripted)[1].detach())

    once = np.mean([(k * gained / before) ** 2 for k in range(10)])
    assert [goal(1.0), goal(-1.0)] == pytest.approx([once, once], rel=1e-4)


def learn_from_contact(net, scripted):
    """Return by agent whether a contact, one of them acting regardless of its policy, moves the weights of an actor."""
    collision, _ = lost(net, [meeting([0.5, 3.0], 2.0, [0.0, -1.4])], [0], steps=30, scripted=scripted)
    assert float(collision.detach()) > 0.01
    collision.backward()
    parameters = {agent: list(net.actor[agent].parameters()) for agent in ("vehicle", "pedestrian")}
    return {a: any(p.grad is not None and bool(p.grad.any()) for p in ps) for a, ps in parameters.items()}


@pytest.mark.parametrize("acceleration", [-5.0, 0.0])
def test_who_meets_a_car_that_stands_or_drives_on_learns_to_avoid_it_and_the_car_learns_nothing(networks, acceleration):
    learned = learn_from_contact(networks(gain=1.0), regardless("vehicle", acceleration))
    assert learned == {"vehicle": False, "pedestrian": True}


def test_a_car_that_meets_somebody_who_walks_on_learns_to_avoid_them_and_they_learn_nothing(networks):
    learned = learn_from_contact(networks(gain=1.0), regardless("pedestrian", 0.0))
    assert learned == {"vehicle": True, "pedestrian": False}


def test_the_given_shares_brake_or_drive_on_or_walk_on_and_never_two_at_once():
    drawn = draw_scripted(4000, 3, 0.25, [0.15, 0.1], np.random.default_rng(0))
    vehicle, pedestrian = (drawn[agent].numpy()[:, 2, 0] for agent in ("vehicle", "pedestrian"))
    braking = vehicle[vehicle < 0.0]
    assert len(braking) / 4000 == pytest.approx(0.25, abs=0.028)  # four standard deviations
    assert -BRAKING[1] <= braking.min() < braking.max() <= -BRAKING[0]
    assert (vehicle == 0.0).mean() == pytest.approx(0.15, abs=0.023)
    assert (pedestrian == 0.0).mean() == pytest.approx(0.1, abs=0.019)
    assert not (~np.isnan(vehicle) & ~np.isnan(pedestrian)).any()
    nobody = draw_scripted(50, 3, 0.0, [0.0, 0.0], np.random.default_rng(0))
    assert all(part.isnan().all() for part in nobody.values())


def test_anticipated_clearance_counts_the_next_two_seconds_at_the_speeds_of_the_moment(networks):
    """5 m/s towards one who stands still: footprints meet after 2.38 m + 0.25 m are left of the distance."""
    still, reach = networks(gain=0.0), 0.5 * VEHICLE_LENGTH + PEDESTRIAN_RADIUS + 0.5

    def anticipated(distance, walking=(0.0, 0.0)):
        history = meeting([distance, 0.0], 5.0, list(walking))
        return float(lost(still, [history], [0], steps=1, anticipation=1.0)[0].detach())

    way = 0.1 * 5.0  # driven in the one step
    for ahead in AHEAD:
        assert anticipated(way + 5.0 * ahead + 0.5 * reach) > 0.0
    assert anticipated(way + 5.0 * AHEAD[-1] + reach + 0.1) == 0.0
    assert anticipated(way + 5.0 * AHEAD[-1] + 0.5 * reach, walking=(0.0, 3.0)) == 0.0, "who walks on is not hit"
    assert float(lost(still, [meeting([8.0, 0.0], 5.0, [0.0, 0.0])], [0], steps=1)[0].detach()) == 0.0


def test_a_roll_out_from_within_a_history_goes_on_with_the_memory_of_it(networks):
    net = networks()
    history = meeting([12.0, 3.0], 4.0, [0.0, -1.0], steps=8)
    history.action["vehicle"][:] = 0.3
    start = moments_at([history, history], np.array([0, 5]))
    for agent in AGENTS:
        before = torch.cat([torch.zeros(1, 2), torch.from_numpy(history.action[agent])])[None, :6]
        seen, curvttc = torch.from_numpy(history.observation[agent])[None, :6], torch.full((1, 6), 3.0)
        whole = net.actor[agent](seen, before, curvttc)[0]
        memory = remembered(net.actor, start)[agent]
        now = torch.stack([seen[0, 0], seen[0, 5]])
        action = net.actor[agent].step(now, start.before[agent], torch.full((2,), 3.0), memory)
        assert action.detach().numpy() == pytest.approx(whole[[0, 5]].detach().numpy(), abs=1e-5)


def test_following_the_gradient_teaches_to_avoid_a_collision(networks):
    net = networks(gain=1.0)
    histories = [meeting([10.0 + d, 0.3], 4.0, [0.0, 0.1]) for d in (0.0, 1.0, 2.0)]
    optimiser = torch.optim.Adam(net.actor.parameters(), 1e-2)
    losses = []
    for _ in range(7):
        collision, _ = lost(net, histories, [0, 0, 0], steps=25)
        losses.append(float(collision.detach()))
        step_along(optimiser, net.actor, collision, lambda: torch.zeros((), requires_grad=True), 0.0, 1.0)
    assert losses[-1] < 0.5 * losses[0]


def test_neither_the_rehearsal_nor_the_simulated_seconds_drown_the_other(networks):
    net = networks()
    first, second, *_ = net.actor.parameters()
    still = torch.optim.SGD(net.actor.parameters(), 0.0)
    norm, rehearsed = step_along(still, net.actor, 1e6 * first.sum(), second.sum, 0.5, 0.1)
    assert rehearsed == float(second.detach().sum())
    assert norm == pytest.approx(1e6 * np.sqrt(first.numel()))
    assert float(first.grad.norm()) == pytest.approx(0.1)
    assert float(second.grad.norm()) == pytest.approx(0.5 * 0.1)


def test_gradients_taken_side_by_side_have_the_bits_of_one_after_the_other(networks):
    net, histories = networks(gain=1.0), [meeting([10.0 + d, 0.3], 4.0, [0.0, 0.1]) for d in (0.0, 1.0, 2.0)]
    parameters = list(net.actor.parameters())

    def both():
        return lost(net, histories, [0, 0, 0], steps=25)[0], lost(net, histories, [1, 2, 3], steps=25)[1]

    alone = [torch.autograd.grad(loss, parameters, materialize_grads=True) for loss in both()]
    collision, goal = both()
    still = torch.optim.SGD(parameters, 0.0)
    step_along(still, net.actor, collision, lambda: goal, 1.0, 1e9)
    assert all(torch.equal(p.grad, one + other) for p, one, other in zip(parameters, *alone, strict=True))


def test_most_moments_are_hand_overs_and_no_history_is_drawn_twice():
    histories = [meeting([10.0, 0.0], 4.0, [0.0, 0.0]) for _ in range(400)]
    picked, at = draw_moments(histories, 300, 0.7, np.random.default_rng(0))
    assert len({id(h) for h in picked}) == 300
    assert 0.68 < (at == 0).mean() < 0.82  # 0.7, and a sixth of the rest
    assert at.max() == 5


def test_transitions_know_where_the_lane_goes():
    scenario = load_scenario(1)
    path = scenario.vehicle.path
    loop = Loop(World(WorldConfig(), [scenario], [(1, 0)], 1, 1), always_critical=True)
    loop.world.state["route_s"] = 15.0
    loop.world.state["vehicle_heading"] = path.heading(15.0) + 2.0 * np.pi
    builder, still = TransitionBuilder([scenario]), Actions(np.zeros((1, 2)), np.zeros((1, 2)))
    rows = np.concatenate([builder.observe(loop.step(still)).transitions for _ in range(3)])
    assert len(rows) == 1
    lane = rows["lane_heading"][0]
    true = [path.heading(15.0 + LANE_GRID * k) - path.heading(15.0) for k in range(LANE_NODES)]
    assert lane == pytest.approx(np.unwrap(true), abs=0.02)
    assert lane[-1] == pytest.approx(-np.pi / 2, abs=0.05)  # it turns right


def test_a_roll_out_that_leaves_the_numbers_ends_in_a_loss_that_says_so(networks):
    broken = networks()
    with torch.no_grad():
        broken.actor["pedestrian"].head[-1].bias.fill_(torch.nan)
    collision, _ = lost(broken, [meeting([12.0, 1.0], 4.0, [0.0, -1.0])], [0])
    assert not bool(collision.isfinite()), "check_losses then stops the run and keeps the batch"
