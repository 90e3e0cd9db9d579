"""What the adapter makes of our messages and of Autoware's, whose packages classes with their fields stand in for."""

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import field, make_dataclass
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import PoseWithCovariance, TwistWithCovariance, Vector3
from nav_msgs.msg import Odometry
from std_msgs.msg import Header

from vpsci_ros.nodes.convert import objects_message
from vpsci_ros.world.kinematics import MAX_ACCELERATION, MAX_DECELERATION, MAX_STEERING_ANGLE, WHEELBASE
from vpsci_ros.world.perception import OBJECT, SEEN


def message(name: str, **fields: Callable[[], Any]) -> type:
    """Return a class of a message with these fields, each made anew, and no others."""
    made = [(key, Any, field(default_factory=default)) for key, default in fields.items()]
    return make_dataclass(name, made, slots=True)


ObjectClassification = message("ObjectClassification", label=int, probability=float)
ObjectClassification.PEDESTRIAN = 7
PredictedPath = message("PredictedPath", path=list, time_step=Duration, confidence=float)
Kinematics = message(
    "Kinematics",
    initial_pose_with_covariance=PoseWithCovariance,
    initial_twist_with_covariance=TwistWithCovariance,
    predicted_paths=list,
)
Shape = message("Shape", type=int, dimensions=Vector3)
Shape.CYLINDER = 1
PredictedObject = message(
    "PredictedObject",
    object_id=lambda: SimpleNamespace(uuid=[0] * 16),
    existence_probability=float,
    classification=list,
    kinematics=Kinematics,
    shape=Shape,
)
PredictedObjects = message("PredictedObjects", header=Header, objects=list)
VelocityReport = message(
    "VelocityReport", header=Header, longitudinal_velocity=float, lateral_velocity=float, heading_rate=float
)


@pytest.fixture(scope="module")
def adapter(tool: Callable[..., ModuleType]) -> Iterator[ModuleType]:
    perception = [ObjectClassification, PredictedObject, PredictedObjects, PredictedPath, Shape]
    others = [SimpleNamespace(__name__=name) for name in ("ControlModeReport", "GearReport", "SteeringReport")]
    packages = {
        "autoware_control_msgs": [SimpleNamespace(__name__="Control")],
        "autoware_perception_msgs": perception,
        "autoware_vehicle_msgs": [VelocityReport, *others],
    }
    with pytest.MonkeyPatch.context() as patch:
        for package, classes in packages.items():
            module = ModuleType(f"{package}.msg")
            module.__dict__.update({each.__name__: each for each in classes})
            patch.setitem(sys.modules, package, ModuleType(package))
            patch.setitem(sys.modules, f"{package}.msg", module)
        yield tool("autoware_adapter", "examples")


def odometry(x: float, y: float, heading: float, speed: float, yaw_rate: float) -> Odometry:
    message = Odometry(header=Header(stamp=Time(sec=3), frame_id="map"), child_frame_id="vehicle/base_link")
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = math.sin(heading / 2), math.cos(heading / 2)
    message.twist.twist.linear.x, message.twist.twist.angular.z = speed, yaw_rate
    return message


def test_the_car_is_half_a_wheelbase_further_back_for_autoware_and_our_message_stays_as_it_was(
    adapter: ModuleType,
) -> None:
    ours = odometry(10.0, 20.0, math.pi / 2, 5.0, 0.4)
    state = adapter.kinematic_state(ours)
    at = state.pose.pose.position
    assert (at.x, at.y) == pytest.approx((10.0, 20.0 - 0.5 * WHEELBASE))
    assert (state.header.frame_id, state.child_frame_id, state.header.stamp.sec) == ("map", "base_link", 3)
    assert state.twist.twist.linear.y == pytest.approx(-0.4 * 0.5 * WHEELBASE), "the rear of a car in a left turn"
    assert ours.pose.pose.position.y == 20.0
    (moved,) = adapter.transform(state).transforms
    assert (moved.header.frame_id, moved.child_frame_id) == ("map", "base_link")
    assert moved.transform.translation.y == at.y
    report = adapter.velocity_report(state)
    assert (report.longitudinal_velocity, report.heading_rate, report.header.frame_id) == (5.0, 0.4, "base_link")
    assert state.header.frame_id == "map"


def test_who_is_seen_becomes_a_pedestrian_whose_path_goes_straight_on(adapter: ModuleType) -> None:
    seen = np.zeros(1, OBJECT)
    seen["x"], seen["y"], seen["vx"], seen["vy"], seen["status"] = 2.0, 3.0, 0.0, -1.5, SEEN
    cloud = objects_message(seen, Time(sec=4))
    (found,) = adapter.predicted_objects(cloud).objects
    assert found.classification == [ObjectClassification(7, 1.0)]
    assert found.kinematics.initial_twist_with_covariance.twist.linear.x == pytest.approx(1.5)
    (path,) = found.kinematics.predicted_paths
    assert (len(path.path), path.time_step.nanosec) == (11, 500_000_000)
    assert (path.path[-1].position.x, path.path[-1].position.y) == pytest.approx((2.0, 3.0 - 5.0 * 1.5))
    turned = path.path[0].orientation
    assert 2.0 * math.atan2(turned.z, turned.w) == pytest.approx(-math.pi / 2)
    assert (found.shape.type, found.shape.dimensions.x, found.shape.dimensions.z) == (1, 0.6, 1.75)
    assert len(found.object_id.uuid) == 16


@pytest.mark.parametrize(
    ("angle", "acceleration", "expected"),
    [
        (0.5 * MAX_STEERING_ANGLE, 0.5 * MAX_ACCELERATION, (0.5, 0.5, 0.0)),
        (-MAX_STEERING_ANGLE, -0.25 * MAX_DECELERATION, (-1.0, 0.0, 0.25)),
        (2.0, -50.0, (1.0, 0.0, 1.0)),
    ],
)
def test_autowares_command_is_our_steer_throttle_and_brake(
    adapter: ModuleType, angle: float, acceleration: float, expected: tuple[float, float, float]
) -> None:
    lateral, longitudinal = SimpleNamespace(steering_tire_angle=angle), SimpleNamespace(acceleration=acceleration)
    control = SimpleNamespace(lateral=lateral, longitudinal=longitudinal)
    found = adapter.vehicle_control(control, adapter.kinematic_state(odometry(0, 0, 0, 1.0, 0.0)))
    assert (found.steer, found.throttle, found.brake) == pytest.approx(expected)
    assert (found.header.frame_id, found.header.stamp.sec) == ("vehicle/base_link", 3)
