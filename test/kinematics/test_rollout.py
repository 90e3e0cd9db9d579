import pytest
import torch

from vpsci_ros.kinematics.lane import OnLane
from vpsci_ros.kinematics.rollout import ActorPair, Draws, Seen, roll_out
from vpsci_ros.kinematics.scene import Scene
from vpsci_ros.policy.config import NetworkConfig
from vpsci_ros.world.observation import AGENTS, LANE_NODES


def start(count: int = 3) -> Scene:
    """Vehicles at 5 m/s towards pedestrians 20 m ahead who cross at 1 m/s."""
    still, row = torch.zeros(count), torch.ones(count, 1)
    ahead, aside = row * torch.tensor([5.0, 0.0]), row * torch.tensor([0.0, 1.0])
    return Scene(torch.zeros(count, 2), still, ahead, still, row * torch.tensor([20.0, -3.0]), aside)


def still(seen: Seen) -> dict[str, torch.Tensor]:
    return {agent: torch.zeros(len(seen.curvttc), 2) for agent in AGENTS}


def pair(networks, **more) -> ActorPair:
    actors = networks.actor
    memory = {agent: actors[agent].empty_history() for agent in AGENTS}
    return ActorPair(actors, memory, {agent: torch.zeros(3, 2) for agent in AGENTS}, **more)


def test_scenes_that_have_ended_take_no_further_step():
    assert [len(scene.heading) for scene in roll_out(start(), still, [3, 2, 2, 1])] == [3, 2, 2, 1]


def test_a_roll_out_that_leaves_the_numbers_ends_in_a_scene_of_nan():
    def act(seen: Seen) -> dict[str, torch.Tensor]:
        return {agent: torch.full((3, 2), torch.nan if seen.step == 1 else 0.0) for agent in AGENTS}

    first, last = roll_out(start(), act, [3] * 5)
    assert first.finite
    assert all(bool(part.isnan().all()) for part in last)


def test_agents_act_as_recorded_as_long_as_something_is_recorded_and_then_by_their_actors(networks):
    made, recorded = networks(gain=1.0), torch.full((3, 2, 2), 0.5)
    recorded[0, 1] = torch.nan
    both, done = pair(made, recorded={"pedestrian": recorded}), []

    def act(seen: Seen) -> dict[str, torch.Tensor]:
        done.append(both(seen)["pedestrian"])
        return both.before

    assert len(list(roll_out(start(), act, [3] * 3))) == 3
    assert [(actions == 0.5).all(dim=1).tolist() for actions in done] == [[True] * 3, [False, True, True], [False] * 3]


def test_the_same_draws_act_the_same_and_others_differ(networks):
    made = networks(NetworkConfig(hidden=16, heads=2, key_dimension=8, latent=3))

    def positions(seed: int) -> torch.Tensor:
        torch.manual_seed(seed)
        draws = Draws({a: torch.randn(3, 3) for a in AGENTS}, {a: torch.randn(3, 2) for a in AGENTS})
        with torch.no_grad():
            return torch.stack([scene.rows() for scene in roll_out(start(), pair(made, draws=draws), [3] * 4)])

    assert torch.equal(positions(1), positions(1))
    assert not torch.equal(positions(1), positions(2))


@pytest.mark.parametrize("gain", [0.5, 1.0])
def test_on_a_straight_lane_an_agent_that_does_nothing_keeps_its_velocity_and_a_lateral_push_moves_no_vehicle(gain):
    begin = start()
    lane = OnLane(torch.zeros(3, LANE_NODES), torch.full((3,), 5.0), begin.pedestrian, begin.pedestrian_velocity, gain)

    def act(seen: Seen) -> dict[str, torch.Tensor]:
        return {"vehicle": torch.tensor([[0.0, 4.0]] * 3), "pedestrian": torch.tensor([[1.0, 0.0]] * 3)}

    *_, last = roll_out(lane.start, act, [3] * 10, lane.advance)
    torch.testing.assert_close(last.vehicle, torch.tensor([[5.0, 0.0]] * 3))
    torch.testing.assert_close(last.pedestrian_velocity, torch.tensor([[gain, 1.0]] * 3))
