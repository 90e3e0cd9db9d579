"""A driving system to copy: keeps a speed, and brakes when it would meet a pedestrian on its path.

It is written as a program of your own would be, with rclpy and public message types alone; docs/ads.md goes through
it, and tells a C++ user the topics. `vpsci ads-test --ads "python my_ads.py"` puts yours to the exam.
"""

import contextlib
import math
import os
import struct
import sys

import rclpy
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

FRONT, SIDE = 2.35, 0.93  # [m] from the vehicle's centre to its bumper and to its side
RADIUS = 0.3  # [m] of the pedestrian


class ExampleAds(Node):
    """`/vehicle/odometry` and the pedestrians in, `/vehicle/cmd_accel` out, one answer a tick.

    The pedestrians come as they are, on `/pedestrian/odometry`, or as perception has them, on `/perception/objects`.
    """

    def __init__(self) -> None:
        super().__init__("example_ads")
        self.cruise = self.declare_parameter("cruise_speed", 4.0).value  # [m/s]
        self.comfort = self.declare_parameter("comfort_acceleration", 2.0).value  # [m/s2]
        self.braking = self.declare_parameter("braking", 3.0).value  # [m/s2] at least, for a pedestrian
        self.strongest = self.declare_parameter("strongest_braking", 8.0).value  # [m/s2]
        self.horizon = self.declare_parameter("horizon", 2.5).value  # [s]
        self.margin = self.declare_parameter("margin", 0.7).value  # [m] to keep free around the vehicle
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
        """Take in where the vehicle is."""
        self.vehicle = message
        self.answer()

    def on_pedestrian(self, message: Odometry) -> None:
        """Take in where the pedestrian is."""
        self.pedestrian = message
        self.answer()

    def on_objects(self, message: PointCloud2) -> None:
        """Take in the pedestrians that are seen."""
        self.seen = message
        self.answer()

    def answer(self) -> None:
        """Answer once vehicle and pedestrians are in for the same tick, under its stamp."""
        if self.vehicle and self.pedestrian and self.vehicle.header.stamp == self.pedestrian.header.stamp:
            self.command_for(self.vehicle, self.pedestrian)
        elif self.vehicle and self.seen and seconds(self.vehicle) - seconds(self.seen) < self.latency + 0.001:
            self.command_for(self.vehicle, *people(self.seen))
            self.vehicle = None  # one answer a tick

    def command_for(self, vehicle: Odometry, *pedestrians: Odometry) -> None:
        """Publish what to do."""
        message = AccelStamped(header=vehicle.header)
        message.accel.linear.x = self.acceleration(vehicle, *pedestrians)
        self.command.publish(message)  # linear.y, to the left, would be added to the world's lane keeping

    def acceleration(self, vehicle: Odometry, *pedestrians: Odometry) -> float:
        """Return what to do with the speed [m/s2]: brake for a contact within the horizon, else go on cruising."""
        speed = vehicle.twist.twist.linear.x
        ahead = max(speed, 1.0)  # standing, it looks whether it could set off
        time = min((self.time_to_contact(vehicle, each, ahead) for each in pedestrians), default=math.inf)
        if time < self.horizon:
            return -min(self.strongest, max(self.braking, 0.5 * speed / max(time, 0.1)))  # to stop just short of it
        return max(-self.comfort, min(self.comfort, (self.cruise - speed) / 0.5))

    def time_to_contact(self, vehicle: Odometry, pedestrian: Odometry, speed: float) -> float:
        """Return when they come within the margin [s], the vehicle at `speed` and its yaw rate, both going on so."""
        x, y, heading = pose(vehicle)
        px, py, direction = pose(pedestrian)
        walking, turning = pedestrian.twist.twist.linear.x, vehicle.twist.twist.angular.z
        time, step = 0.0, 0.1  # [s]
        while time < self.horizon:
            forward = math.cos(heading) * (px - x) + math.sin(heading) * (py - y)
            left = math.cos(heading) * (py - y) - math.sin(heading) * (px - x)
            if abs(forward) < FRONT + RADIUS + self.margin and abs(left) < SIDE + RADIUS + self.margin:
                return time
            time, heading = time + step, heading + turning * step
            x, y = x + speed * step * math.cos(heading), y + speed * step * math.sin(heading)
            px, py = px + walking * step * math.cos(direction), py + walking * step * math.sin(direction)
        return math.inf


def pose(odometry: Odometry) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad], counter-clockwise from x (REP 103)."""
    at, turned = odometry.pose.pose.position, odometry.pose.pose.orientation
    return at.x, at.y, 2.0 * math.atan2(turned.z, turned.w)


def seconds(message: Odometry | PointCloud2) -> float:
    """Return the simulated time of a message's stamp [s]."""
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def people(objects: PointCloud2) -> list[Odometry]:
    """Return the points of a list of objects, each x, y, z, vx, vy in the map [m, m/s] and a number, as odometry."""
    found = []
    for offset in range(0, len(objects.data), objects.point_step):
        x, y, _, vx, vy, _ = struct.unpack_from("<5fI", objects.data, offset)
        person, direction = Odometry(header=objects.header), math.atan2(vy, vx)
        person.pose.pose.position.x, person.pose.pose.position.y = x, y
        person.pose.pose.orientation.z, person.pose.pose.orientation.w = (
            math.sin(direction / 2),
            math.cos(direction / 2),
        )
        person.twist.twist.linear.x = math.hypot(vx, vy)
        found.append(person)
    return found


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
