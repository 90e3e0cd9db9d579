"""Autoware at the wheel of the exam's car: our topics become Autoware's, and its control command becomes ours.

A program of your own ROS 2 workspace, which has Autoware's messages and vpsci_msgs; docs/autoware.md goes through it
step by step, and says what was not tried for want of Autoware. The functions convert, the node wires them.
"""

import contextlib
import copy
import math
import struct
import sys
import uuid

import rclpy
from autoware_control_msgs.msg import Control
from autoware_perception_msgs.msg import ObjectClassification, PredictedObject, PredictedObjects, PredictedPath, Shape
from autoware_vehicle_msgs.msg import ControlModeReport, GearReport, SteeringReport, VelocityReport
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import AccelWithCovarianceStamped, Pose, TransformStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from vpsci_msgs.msg import VehicleControl

WHEELBASE = 2.875  # [m] of the Model 3; Autoware's base_link, the middle of the rear axle, is half of it behind ours
STEERING, FORWARD, BRAKING = 0.52, 9.25, 8.88  # [rad], [m/s2], [m/s2] that our steer, throttle and brake 1 stand for
SLOW = 0.1  # [m/s] below which a yaw rate says nothing of the wheels
HORIZON, STEP = 5.0, 0.5  # [s] of the paths of objects
SIZE = 0.6, 1.75  # [m] diameter and height of a pedestrian


def kinematic_state(odometry: Odometry) -> Odometry:
    """Return the car's odometry at its rear axle, in the frames that Autoware has."""
    found = copy.deepcopy(odometry)
    found.header.frame_id, found.child_frame_id = "map", "base_link"
    turned, at = found.pose.pose.orientation, found.pose.pose.position
    heading = 2.0 * math.atan2(turned.z, turned.w)
    at.x -= 0.5 * WHEELBASE * math.cos(heading)
    at.y -= 0.5 * WHEELBASE * math.sin(heading)
    found.twist.twist.linear.y = -0.5 * WHEELBASE * found.twist.twist.angular.z
    return found


def transform(state: Odometry) -> TFMessage:
    """Return `map` to `base_link` of a kinematic state."""
    found = TransformStamped(header=state.header, child_frame_id=state.child_frame_id)
    at, where = state.pose.pose.position, found.transform.translation
    where.x, where.y, where.z = at.x, at.y, at.z
    found.transform.rotation = state.pose.pose.orientation
    return TFMessage(transforms=[found])


def velocity_report(state: Odometry) -> VelocityReport:
    """Return the car's speed and yaw rate."""
    twist = state.twist.twist
    found = VelocityReport(header=Header(stamp=state.header.stamp, frame_id="base_link"))
    found.longitudinal_velocity, found.lateral_velocity = twist.linear.x, twist.linear.y
    found.heading_rate = twist.angular.z
    return found


def tire_angle(state: Odometry, before: float) -> float:
    """Return the angle of the front wheels [rad] on a bicycle; `before` where the car hardly moves."""
    twist = state.twist.twist
    return math.atan(WHEELBASE * twist.angular.z / twist.linear.x) if twist.linear.x > SLOW else before


def predicted_objects(cloud: PointCloud2) -> PredictedObjects:
    """Return /perception/objects (float32 x, y, z, vx, vy in the map and uint32 of the track) as pedestrians.

    Their paths go on at the velocity that was seen.
    """
    found = PredictedObjects(header=Header(stamp=cloud.header.stamp, frame_id="map"))
    for start in range(0, len(cloud.data), cloud.point_step):
        x, y, _, vx, vy, track = struct.unpack_from("<5fI", cloud.data, start)
        found.objects = [*found.objects, _pedestrian(x, y, vx, vy, track)]
    return found


def _pedestrian(x: float, y: float, vx: float, vy: float, track: int) -> PredictedObject:
    found = PredictedObject(existence_probability=1.0)
    found.object_id.uuid = list(uuid.UUID(int=track).bytes)
    found.classification = [ObjectClassification(label=ObjectClassification.PEDESTRIAN, probability=1.0)]
    heading = math.atan2(vy, vx)
    found.kinematics.initial_pose_with_covariance.pose = _pose(x, y, heading)
    found.kinematics.initial_twist_with_covariance.twist.linear.x = math.hypot(vx, vy)
    times = [STEP * k for k in range(round(HORIZON / STEP) + 1)]
    step = Duration(sec=int(STEP), nanosec=round(STEP % 1.0 * 1e9))
    path = PredictedPath(path=[_pose(x + vx * t, y + vy * t, heading) for t in times], time_step=step, confidence=1.0)
    found.kinematics.predicted_paths = [path]
    found.shape = Shape(type=Shape.CYLINDER)
    found.shape.dimensions.x = found.shape.dimensions.y = SIZE[0]
    found.shape.dimensions.z = SIZE[1]
    return found


def _pose(x: float, y: float, heading: float) -> Pose:
    pose = Pose()
    pose.position.x, pose.position.y = x, y
    pose.orientation.z, pose.orientation.w = math.sin(heading / 2.0), math.cos(heading / 2.0)
    return pose


def vehicle_control(control: Control, state: Odometry) -> VehicleControl:
    """Return Autoware's command as steer, throttle and brake, stamped for the tick of a kinematic state."""
    wanted = control.longitudinal.acceleration
    found = VehicleControl(header=Header(stamp=state.header.stamp, frame_id="vehicle/base_link"))
    found.steer = max(-1.0, min(1.0, control.lateral.steering_tire_angle / STEERING))
    found.throttle = max(0.0, min(1.0, wanted / FORWARD))
    found.brake = max(0.0, min(1.0, -wanted / BRAKING))
    return found


class AutowareAdapter(Node):
    """`/vehicle/odometry` and `/perception/objects` in, Autoware's inputs out; its control command in, ours out."""

    def __init__(self) -> None:
        super().__init__("autoware_adapter")
        out = self.create_publisher
        self.state: Odometry | None = None
        self.angle = self.speed = self.time = 0.0  # [rad], [m/s], [s] of the last state
        self.state_out = out(Odometry, "/localization/kinematic_state", 1)
        self.acceleration_out = out(AccelWithCovarianceStamped, "/localization/acceleration", 1)
        self.velocity_out = out(VelocityReport, "/vehicle/status/velocity_status", 1)
        self.steering_out = out(SteeringReport, "/vehicle/status/steering_status", 1)
        self.mode_out = out(ControlModeReport, "/vehicle/status/control_mode", 1)
        self.gear_out = out(GearReport, "/vehicle/status/gear_status", 1)
        self.objects_out = out(PredictedObjects, "/perception/object_recognition/objects", 1)
        self.transform_out = out(TFMessage, "/tf", 100)
        self.command_out = out(VehicleControl, "vehicle/cmd_control", 10)
        self.create_subscription(Odometry, "vehicle/odometry", self.on_odometry, 10)
        self.create_subscription(PointCloud2, "perception/objects", self.on_objects, 10)
        self.create_subscription(Control, "/control/command/control_cmd", self.on_control, 1)

    def on_odometry(self, odometry: Odometry) -> None:
        """Publish where the car is, in all of the forms in which Autoware reads it."""
        state = self.state = kinematic_state(odometry)
        stamp, speed = state.header.stamp, state.twist.twist.linear.x
        time = stamp.sec + 1e-9 * stamp.nanosec
        acceleration = AccelWithCovarianceStamped(header=state.header)
        if 0.0 < time - self.time < 1.0:  # otherwise an episode has begun
            acceleration.accel.accel.linear.x = (speed - self.speed) / (time - self.time)
        self.angle, self.speed, self.time = tire_angle(state, self.angle), speed, time
        self.transform_out.publish(transform(state))
        self.state_out.publish(state)
        self.acceleration_out.publish(acceleration)
        self.steering_out.publish(SteeringReport(stamp=stamp, steering_tire_angle=self.angle))
        self.mode_out.publish(ControlModeReport(stamp=stamp, mode=ControlModeReport.AUTONOMOUS))
        self.gear_out.publish(GearReport(stamp=stamp, report=GearReport.DRIVE))
        self.velocity_out.publish(velocity_report(state))

    def on_objects(self, cloud: PointCloud2) -> None:
        """Publish who is seen."""
        self.objects_out.publish(predicted_objects(cloud))

    def on_control(self, control: Control) -> None:
        """Publish Autoware's command as an answer to the latest tick."""
        if self.state is not None:
            self.command_out.publish(vehicle_control(control, self.state))


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    rclpy.init(args=args)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(AutowareAdapter())
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
