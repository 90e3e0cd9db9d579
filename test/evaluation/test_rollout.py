import torch

from vpsci_ros.evaluation.roll_out import Seen, roll_out
from vpsci_ros.evaluation.scene import Scene
from vpsci_ros.world.observation import AGENTS


def start(count: int = 3) -> Scene:
    """Vehicles at 5 m/s towards pedestrians 20 m ahead who cross at 1 m/s."""
    still, row = torch.zeros(count), torch.ones(count, 1)
    ahead, aside = row * torch.tensor([5.0, 0.0]), row * torch.tensor([0.0, 1.0])
    return Scene(torch.zeros(count, 2), still, ahead, still, row * torch.tensor([20.0, -3.0]), aside)


def still(seen: Seen) -> dict[str, torch.Tensor]:
    return {agent: torch.zeros(len(seen.curvttc), 2) for agent in AGENTS}


def test_scenes_that_have_ended_take_no_further_step():
    assert [len(scene.heading) for scene in roll_out(start(), still, [3, 2, 2, 1])] == [3, 2, 2, 1]


def test_a_roll_out_that_leaves_the_numbers_ends_in_a_scene_of_nan():
    def act(seen: Seen) -> dict[str, torch.Tensor]:
        return {agent: torch.full((3, 2), torch.nan if seen.step == 1 else 0.0) for agent in AGENTS}

    first, last = roll_out(start(), act, [3] * 5)
    assert first.finite
    assert all(bool(part.isnan().all()) for part in last)
