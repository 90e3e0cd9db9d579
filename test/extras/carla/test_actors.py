"""CARLA's left-handed frame and ours, and a walker in somebody's synchronous world."""

import math

import numpy as np
import pytest

carla = pytest.importorskip("carla", reason="pip install 'vpsci_ros[carla]'")

from extras.carla.stand_in import StandInActor  # noqa: E402

from vpsci_ros import Pedestrian, Vehicle, Walker  # noqa: E402
from vpsci_ros.extras.carla.actors import vehicle_of, vehicle_transform, walker_control, walker_of  # noqa: E402
from vpsci_ros.extras.carla.walker import LearnedWalker  # noqa: E402


def actor(kind="vehicle.x", x=0.0, y=0.0, yaw=0.0, velocity=(0.0, 0.0), turning=0.0):
    placed = carla.Transform(carla.Location(x, y, 0.5), carla.Rotation(yaw=yaw))
    return StandInActor(7, kind, placed, velocity=carla.Vector3D(*velocity, 0.0), turning=turning)


def test_a_car_that_heads_south_in_carla_and_turns_right_does_so_in_our_frame():
    found = vehicle_of(actor(x=10.0, y=20.0, yaw=90.0, velocity=(0.0, 5.0), turning=30.0))
    # y = 20 is 20 m south; clockwise 90 degrees is south; the box's middle lies 0.2 m ahead, further south
    assert (found.x, found.y) == pytest.approx((10.0, -20.2), abs=1e-5)
    assert found.heading == pytest.approx(-math.pi / 2)
    assert found.speed == pytest.approx(5.0)
    assert found.curvature == pytest.approx(-math.radians(30.0) / 5.0), "clockwise is a turn to the right, below 0"
    assert (found.length, found.width) == pytest.approx((4.8, 1.9))


@pytest.mark.parametrize("heading", [0.7, -1.2])
def test_a_vehicle_that_is_put_somewhere_is_there(heading):
    wanted = Vehicle(-103.9, -46.2, heading, 3.0)
    placed = vehicle_transform(wanted, actor().bounding_box.location, 0.3)
    car = StandInActor(1, "vehicle.x", placed)
    car.set_target_velocity(carla.Vector3D(3.0 * math.cos(heading), -3.0 * math.sin(heading), 0.0))
    found = vehicle_of(car)
    assert (found.x, found.y, found.heading, found.speed) == pytest.approx(wanted[:4], abs=1e-4)
    assert placed.location.z == pytest.approx(0.3)


def test_a_walker_walks_with_the_velocity_that_was_wanted():
    walker = actor("walker.x", x=1.0, y=2.0)
    walker.apply_control(walker_control(0.6, 0.8))
    walker.move(0.5)
    assert walker_of(walker) == pytest.approx(Walker(1.3, -1.6, 0.6, 0.8), abs=1e-5)
    walker.apply_control(walker_control(0.0, 0.0))
    walker.move(0.5)
    assert walker_of(walker) == pytest.approx(Walker(1.3, -1.6, 0.0, 0.0), abs=1e-5)


def test_a_learned_walker_goes_where_the_object_goes_and_reacts_to_the_car_by_its_id():
    route = [(0.0, -8.0), (0.0, 8.0)]
    walker, car = actor("walker.x", y=5.0), actor(x=-25.0, velocity=(4.0, 0.0))  # 5 m to the south of the car's way
    car.id, car.control = 8, carla.VehicleControl()
    learned = LearnedWalker(walker, Pedestrian(seed=1, episode=4, route=route))
    twin, faced = Pedestrian(seed=1, episode=4, route=route), set()
    for _ in range(160):
        expected = twin.step(walker_of(walker), {8: vehicle_of(car)}, {})
        walk = learned.step([car], [walker])
        assert walk == expected, "the walker's own actor is left out of the others"
        faced |= {walk.faces} if walk.controlled else set()
        for each in (walker, car):
            each.move(0.05)
        assert walker_of(walker)[2:] == pytest.approx((walk.vx, walk.vy), abs=1e-5)
    assert faced == {8}
    assert np.hypot(*walker_of(walker)[:2]) > 1.0
    assert walker_of(walker).y > -4.0, "it went north, which is up in our frame and y below in CARLA's"
