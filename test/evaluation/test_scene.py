import numpy as np
import pytest
import torch

from vpsci_ros.evaluation.scene import (
    SHARPEST_TURN,
    Scene,
    advance,
    from_heading_frame,
    observe,
    scene_at,
    time_to_collision,
    to_heading_frame,
)
from vpsci_ros.world.observation import arrays_to_heading_frame, observe_arrays


def scenes(batch=6, seed=0):
    rng = np.random.default_rng(seed)
    heading = rng.uniform(-np.pi, np.pi, batch)
    speed = rng.uniform(1.0, 9.0, batch)
    velocity = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    parts = (
        rng.normal(0, 9, (batch, 2)),
        heading,
        velocity,
        np.zeros(batch),
        rng.normal(0, 9, (batch, 2)),
        rng.normal(0, 1, (batch, 2)),
    )
    return Scene(*(torch.from_numpy(p) for p in parts))


def test_observations_are_those_of_the_world():
    scene = scenes()
    mine = observe(scene)
    place, walker = scene.vehicle.numpy(), scene.pedestrian.numpy()
    velocity, walking = scene.vehicle_velocity.numpy(), scene.pedestrian_velocity.numpy()
    theirs = observe_arrays(*place.T, scene.heading.numpy(), *velocity.T, *walker.T, *walking.T)
    for a, b in zip(mine, theirs, strict=True):
        np.testing.assert_allclose(a.numpy(), b, atol=1e-5)


def test_the_heading_frame_of_tensors_is_that_of_arrays():
    rng = np.random.default_rng(2)
    headings, vectors = rng.uniform(-4.0, 4.0, (20, 3)), rng.normal(0.0, 9.0, (20, 3, 2))
    turned = to_heading_frame(torch.from_numpy(vectors), torch.from_numpy(headings))
    np.testing.assert_allclose(turned.numpy(), arrays_to_heading_frame(headings, vectors), rtol=0.0, atol=1e-14)
    back = from_heading_frame(turned, torch.from_numpy(headings))
    np.testing.assert_allclose(back.numpy(), vectors, rtol=0.0, atol=1e-13)


def test_the_next_velocities_are_those_of_equations_8_and_9():
    scene = scenes()
    action = torch.tensor([[1.0, 0.1]] * 6, dtype=torch.float64)
    after = advance(scene, {"vehicle": action, "pedestrian": action})
    c, s = torch.cos(scene.heading), torch.sin(scene.heading)
    gained = 0.1 * torch.stack([c * 1.0 - s * 0.1, s * 1.0 + c * 0.1], dim=1)
    torch.testing.assert_close(after.pedestrian_velocity, scene.pedestrian_velocity + gained)
    torch.testing.assert_close(after.vehicle_velocity, scene.vehicle_velocity + gained)  # gentle enough to steer
    along = torch.atan2(after.vehicle_velocity[:, 1], after.vehicle_velocity[:, 0])
    torch.testing.assert_close(torch.cos(along - after.heading), torch.ones(6, dtype=torch.float64))


def test_a_braking_vehicle_stops_and_does_not_roll_back():
    scene = scenes()
    none, brake = torch.zeros(6, 2, dtype=torch.float64), torch.tensor([[-5.0, 0.0]] * 6, dtype=torch.float64)
    for _ in range(30):
        scene = advance(scene, {"vehicle": brake, "pedestrian": none})
    assert scene.vehicle_velocity.abs().max() == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_vehicle_turns_no_more_sharply_than_it_steers(side):
    scene = scenes()
    none, hard = torch.zeros(6, 2, dtype=torch.float64), torch.tensor([[-2.0, 5.0 * side]] * 6, dtype=torch.float64)
    for _ in range(40):
        before, scene = scene, advance(scene, {"vehicle": hard, "pedestrian": none})
        path = 0.1 * scene.vehicle_velocity.norm(dim=1)
        assert ((scene.heading - before.heading) * side <= SHARPEST_TURN * path + 1e-9).all()


def test_gradients_flow_to_every_action_and_stay_finite_at_rest():
    scene = scenes()
    actions = torch.full((12, 6, 2), -5.0, dtype=torch.float64, requires_grad=True)
    for action in actions:
        scene = advance(scene, {"vehicle": action, "pedestrian": action})
    (scene.vehicle.sum() + scene.pedestrian.sum()).backward()
    assert torch.isfinite(actions.grad).all()
    assert (actions.grad[0] != 0.0).all()


def test_curvttc_sees_the_turn_the_vehicle_is_in():
    """A vehicle on a circle of 10 m around the origin; one pedestrian stands on that circle, one does not."""
    motion = torch.tensor(
        [[10.0, 0.0, np.pi / 2, 0.0, 5.0, 0.0, 10.0, 0.0, 0.0], [10.0, 0.0, np.pi / 2, 0.0, 5.0, 10.0, 10.0, 0.0, 0.0]]
    )
    before = motion.clone()
    before[:, 2] -= 0.05  # 0.5 rad/s at 5 m/s
    ttc = time_to_collision(scene_at(torch.stack([before, motion], dim=1).double(), torch.tensor([1, 1])))
    assert 1.0 < ttc[0] < 3.0
    assert ttc[1] == np.inf


def braking(steps=12, heading=0.4):
    """A car that brakes from 6 m/s at 1 m/s2 along `heading`, published with speeds that lag 0.8 m/s behind."""
    time = 0.1 * torch.arange(steps, dtype=torch.float64)
    way, ahead = 6.0 * time - 0.5 * time**2, torch.tensor([np.cos(heading), np.sin(heading)], dtype=torch.float64)
    motion = torch.zeros(1, steps, 9, dtype=torch.float64)
    motion[0, :, :2], motion[0, :, 2] = way[:, None] * ahead, heading
    motion[0, :, 3:5] = (6.8 - time)[:, None] * ahead
    return motion


def test_a_tracked_scene_starts_from_the_speed_that_positions_tell():
    motion, at = braking(), torch.tensor([9])
    for steps, speed in ((0, 5.9), (1, 5.1), (3, 5.1)):
        assert float(scene_at(motion, at, steps).vehicle_velocity.norm()) == pytest.approx(speed, abs=1e-9)
    assert float(scene_at(motion, torch.tensor([0]), 3).vehicle_velocity.norm()) == pytest.approx(6.8)
    for part, recorded in zip(scene_at(motion, at, 3)[4:], scene_at(motion, at, 0)[4:], strict=True):
        assert torch.equal(part, recorded), "a pedestrian's speed is as recorded"


def test_a_tracked_car_in_a_bend_sets_out_along_its_path_although_its_published_heading_lags():
    time, lag = 0.1 * torch.arange(12, dtype=torch.float64), 0.05  # 5 m/s on a circle of 10 m: 0.5 rad/s
    course = 0.5 * time
    motion = torch.zeros(1, 12, 9, dtype=torch.float64)
    motion[0, :, 0], motion[0, :, 1], motion[0, :, 2] = 10 * torch.sin(course), -10 * torch.cos(course), course - lag
    motion[0, :, 3], motion[0, :, 4] = 5 * torch.cos(course - lag), 5 * torch.sin(course - lag)
    for steps, expected in ((0, course[9] - lag), (2, course[9])):
        velocity = scene_at(motion, torch.tensor([9]), steps).vehicle_velocity[0]
        assert float(torch.atan2(velocity[1], velocity[0])) == pytest.approx(float(expected), abs=4e-3)


def test_tracking_uses_no_step_after_the_start_and_never_sends_a_car_backwards():
    motion, at = braking(), torch.tensor([9])
    known = scene_at(motion, at, 3).vehicle_velocity
    motion[0, 10:] = 99.0
    assert torch.equal(scene_at(motion, at, 3).vehicle_velocity, known)
    motion[0, 6:10, :2] -= torch.arange(4)[:, None]  # a tracker that jumps
    assert float(scene_at(motion, at, 3).vehicle_velocity.norm()) == pytest.approx(0.0, abs=1e-12)
