"""Roll-outs with gradients: they move as the world does, and follow what they are asked to follow."""

import numpy as np
import pytest
import torch

from vpsci_ros.data.interactions import from_table
from vpsci_ros.evaluation.scene import Scene
from vpsci_ros.learning.closed_loop import DualWeight, Lane, Recorded, clearance, penalties, roll_out, simulated_start
from vpsci_ros.learning.rewards import SimulatedRewards
from vpsci_ros.learning.training_config import ClosedLoopConfig, RewardsConfig
from vpsci_ros.learning.transitions import TransitionBuilder
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.safety import clearance as exact_clearance
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.observation import AGENTS

SMALL, STEPS = NetworkConfig(hidden=16, heads=2), 15
MIXED, SCENARIOS = WorldConfig(spawn="mixed"), load_scenarios([1, 3, 6])
EPISODES = [(scenario, number) for number in range(6) for scenario in (1, 3, 6)]


@pytest.fixture(scope="module")
def simulated(networks):
    """Untrained networks with some will of their own, and simulated histories of both kinds of scenes by them."""
    made = networks(SMALL, gain=3.0)
    world, builder = World(MIXED, SCENARIOS, EPISODES, len(EPISODES), 5), TransitionBuilder(MIXED, SCENARIOS)
    agents = policies(made.weights({}, {}), world)
    episodes = [whole for step in Loop(world, agents) for whole in builder.observe(step)[1]]
    histories = SimulatedRewards(RewardsConfig(), made).histories(episodes, 0.99)
    return made, [history for history in histories if len(history) > STEPS]


@pytest.mark.parametrize(("papers", "most"), [(True, 0.05), (False, 0.1)])
def test_a_roll_out_moves_both_agents_as_the_world_did(simulated, papers, most):
    """Relative places [m] and speeds [m/s] after 1.5 s; in default scenes with lane keeping and a limit of jerk."""
    made, histories = simulated
    own = [history for history in histories if (history.rules[2] == 0) == papers]
    assert len(own) > 3
    start = simulated_start(own, [0] * len(own))
    with torch.no_grad():
        (*_, (scene, _)) = roll_out(made.actor, start, STEPS)
    seen = torch.from_numpy(np.stack([history.observation["vehicle"][STEPS] for history in own]))
    assert (scene.vehicle_velocity.norm(dim=1) - seen[:, 0]).abs().max() < most
    apart = (scene.pedestrian - scene.vehicle).norm(dim=1)
    assert (apart - seen[:, 2:4].norm(dim=1)).abs().max() < 3 * most
    moved = (seen[:, 2:4] - start.scene.pedestrian.neg()).norm(dim=1)
    assert moved.min() > 0.5


def test_the_rule_based_pair_takes_over_after_the_release_time_and_goes_on_at_its_wanted_speeds(simulated):
    made, histories = simulated
    start = simulated_start(histories, [0] * len(histories))
    away = start.scene._replace(pedestrian=start.scene.pedestrian + 1000.0)
    free = type(start)(**vars(start) | {"scene": away, "curvttc": torch.full_like(start.curvttc, torch.inf)})
    with torch.no_grad():
        (*_, (scene, _)) = roll_out(made.actor, free, 0, 60)
    speeds = torch.stack([scene.vehicle_velocity.norm(dim=1), scene.pedestrian_velocity.norm(dim=1)], dim=1)
    off, before = ((each - free.wanted).abs().mean() for each in (speeds, speeds * 0.0))
    assert off < 0.3 * before


def test_clearance_is_that_of_the_monitor():
    rng = np.random.default_rng(0)
    heading, place = rng.uniform(-3.0, 3.0, 200), rng.normal(0.0, 3.0, (200, 2))
    zero, values = torch.zeros(200, 2), (torch.from_numpy(part.astype(np.float32)) for part in (heading, place))
    turned, there = values
    found = clearance(Scene(zero, turned, zero, turned, there, zero))
    np.testing.assert_allclose(found, exact_clearance(0.0, 0.0, heading, place[:, 0], place[:, 1]), atol=2e-3)


def test_a_place_beside_a_bent_lane_is_projected_onto_it():
    angle = torch.arange(16) * 2.5 / 20.0
    lane = Lane(torch.stack([20.0 * torch.sin(angle), 20.0 - 20.0 * torch.cos(angle)], dim=1)[None])
    s, left, way = lane.project(torch.tensor([[19.0 * np.sin(0.5), 20.0 - 19.0 * np.cos(0.5)]]).float())
    assert s.item() == pytest.approx(10.0, abs=0.1)
    assert left.item() == pytest.approx(1.0, abs=0.05), "a left turn's inner side"
    assert way[0].tolist() == pytest.approx([np.cos(0.5), np.sin(0.5)], abs=0.07)


def test_braking_and_waiting_lower_what_is_wrong_where_both_would_meet(simulated):
    """The gradient of the nearness by each agent's output bias: against it somebody slows down or both part."""
    made, histories = simulated
    config, start = ClosedLoopConfig(), simulated_start(histories, [0] * len(histories))
    losses = []
    for _ in range(25):
        scenes, done = zip(*roll_out(made.actor, start, 25), strict=True)
        loss = penalties(start, scenes, done, ClosedLoopConfig(**vars(config) | {"steps": 25})).near.mean()
        losses.append(float(loss.detach()))
        parameters = list(made.actor.parameters())
        for parameter, gradient in zip(parameters, torch.autograd.grad(loss, parameters), strict=True):
            with torch.no_grad():
                parameter.sub_(0.02 * gradient.sign())
    assert min(losses[-5:]) < 0.6 * losses[0]


def test_recorded_starts_are_mirrored_and_moved_and_their_error_is_that_of_their_own_roll_out(near_misses, networks):
    interactions, config = from_table(near_misses), ClosedLoopConfig()
    drawn = Recorded(interactions, config).draw(np.random.default_rng(3))
    assert drawn.known.any(dim=1).all()
    truth = [
        drawn.start.scene._replace(vehicle=drawn.vehicle[:, step], pedestrian=drawn.pedestrian[:, step])
        for step in range(config.imitated_steps)
    ]
    assert drawn.error(truth).item() == pytest.approx(0.05), "the bound below which errors are squares"
    made = networks(SMALL)
    scenes = [scene for scene, _ in roll_out(made.actor, drawn.start, config.imitated_steps)]
    assert 0.1 < drawn.error(scenes).item() < 2.0
    for agent in AGENTS:
        assert drawn.start.came[agent].abs().max() > 0.3


def test_the_weight_of_imitation_grows_while_its_error_is_above_the_limit_and_goes_on_from_a_checkpoint():
    weight = DualWeight(ClosedLoopConfig())
    first = weight.value
    for _ in range(5):
        weight.note(1.0)
    assert weight.value == pytest.approx(first * 1.02**5)
    again = DualWeight(ClosedLoopConfig())
    again.load_state_dict(weight.state_dict())
    for _ in range(500):
        weight.note(0.0)
        again.note(0.0)
    assert weight.value == again.value == DualWeight.LEAST
