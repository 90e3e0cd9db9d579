"""An example of a driving system as a node: it reads odometry and publishes `example_driver`'s acceleration.

It is written as a program of your own would be, with rclpy and public message types alone; docs/ads.md goes through
it, and shows a C++ user the topics. `vpsci ads-test --ads "python my_ads.py"` puts yours to the exam.
"""

import contextlib
import math
import os
import struct
import sys
from dataclasses import fields

import rclpy
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from vpsci_ros.nodes.example_driver import ExampleDriver, Mover  # the file beside this one: copy it, too


class ExampleAds(Node):
    """Subscribes to `/vehicle/odometry` and the pedestrians; publishes one `/vehicle/cmd_accel` a tick.

    It reads the first pedestrian's true motion on `/pedestrian/odometry`, or all perceived pedestrians on
    `/perception/objects`.
    """

    def __init__(self) -> None:
        super().__init__("example_ads")
        given = {each.name: self.declare_parameter(each.name, each.default).value for each in fields(ExampleDriver)}
        self.driver = ExampleDriver(**given)
        self.objects = self.declare_parameter("objects", False).value  # take /perception/objects
        self.latency = self.declare_parameter("objects_latency", 0.0).value  # [s] by which they come late at most
        self.vehicle: Odometry | None = None
        self.pedestrian: Odometry | None = None
        self.seen: PointCloud2 | None = None
        self.command = self.create_publisher(AccelStamped, "vehicle/cmd_accel", 10)
        self.create_subscription(Odometry, "vehicle/odometry", self.on_vehicle, 10)
        if self.objects:
            self.create_subscription(PointCloud2, "perception/objects", self.on_objects, 10)
        else:
            self.create_subscription(Odometry, "pedestrian/odometry", self.on_pedestrian, 10)

    def on_vehicle(self, message: Odometry) -> None:
        """Store the vehicle's odometry, and answer its tick if the pedestrians have arrived."""
        self.vehicle = message
        self.answer()

    def on_pedestrian(self, message: Odometry) -> None:
        """Store the pedestrian's odometry, and answer its tick if the vehicle's has arrived."""
        self.pedestrian = message
        self.answer()

    def on_objects(self, message: PointCloud2) -> None:
        """Store the perceived pedestrians, and answer the vehicle's tick if they are recent enough for it."""
        self.seen = message
        self.answer()

    def answer(self) -> None:
        """Publish the command, with the stamp of the vehicle's odometry, when the tick's pedestrians have arrived."""
        if self.vehicle and self.pedestrian and self.vehicle.header.stamp == self.pedestrian.header.stamp:
            self.command_for(self.vehicle, [mover(self.pedestrian)])
        elif self.vehicle and self.seen and seconds(self.vehicle) - seconds(self.seen) < self.latency + 0.001:
            self.command_for(self.vehicle, people(self.seen))
            self.vehicle = None  # one answer a tick

    def command_for(self, vehicle: Odometry, pedestrians: list[Mover]) -> None:
        """Publish the command for these states of vehicle and pedestrians."""
        message = AccelStamped(header=vehicle.header)
        message.accel.linear.x = self.driver.acceleration(mover(vehicle), pedestrians)
        self.command.publish(message)  # linear.y, to the left, would be added to the world's lane keeping


def mover(odometry: Odometry) -> Mover:
    """Return position [m], yaw [rad], speed [m/s] and yaw rate [rad/s] of an odometry message (REP 103)."""
    at, turned, twist = odometry.pose.pose.position, odometry.pose.pose.orientation, odometry.twist.twist
    return Mover(at.x, at.y, 2.0 * math.atan2(turned.z, turned.w), twist.linear.x, twist.angular.z)


def seconds(message: Odometry | PointCloud2) -> float:
    """Return the simulated time of a message's stamp [s]."""
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def people(objects: PointCloud2) -> list[Mover]:
    """Return the pedestrians of `/perception/objects`: points x, y, z [m], vx, vy [m/s] in the map, track number."""
    offsets = range(0, len(objects.data), objects.point_step)
    points = (struct.unpack_from("<5fI", objects.data, offset) for offset in offsets)
    return [Mover(x, y, math.atan2(vy, vx), math.hypot(vx, vy)) for x, y, _, vx, vy, _ in points]


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")  # as the graph's own nodes
    rclpy.init(args=args)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(ExampleAds())
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
