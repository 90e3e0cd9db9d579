"""A public motion planner put to the exam as an ADS node: FISS+ samples trajectories in the Frenet frame of the lane.

    pip install -c constraints.txt '.[ros,messages,planner]'
    vpsci ads-test --params params/ads_test.yaml -o out/planner --ads "python examples/motion_planner.py"

The planner is fiss-planner 1.0.0 (Sun et al., RA-L 2022 and IROS 2023; Apache-2.0). At every second tick it searches
the end states of polynomials along the lane, and checks what it finds against each pedestrian at constant velocity; at
every tick its own model-predictive controller follows the plan, through `/vehicle/cmd_control`. Vehicle and scenario
come from `/world/state`; so do the pedestrians, as they truly are, or with `--objects LATENCY` from
`/perception/objects`. The same in one process, many episodes side by side:

    PYTHONPATH=examples vpsci ads-test --params params/ads_test.yaml -o out/planner \
        --ads-class motion_planner:PlannerDriver
"""

import argparse
import contextlib
import math
import struct
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import fiss_planner as fp
import numpy as np
from numpy.typing import NDArray

from vpsci_ros.safety import VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.wire.world_state import StateContent, read_world_state
from vpsci_ros.world import IDLE, Scenario, load_scenarios
from vpsci_ros.world.kinematics import MAX_ACCELERATION, MAX_DECELERATION, MAX_STEERING_ANGLE, WHEELBASE
from vpsci_ros.world.scenario import further_files, scenario_files

if TYPE_CHECKING:
    from sensor_msgs.msg import PointCloud2


CRUISE = 4.0  # [m/s], as example_ads does
HOLD = 2  # ticks from plan to plan: 0.1 s
TICK = 0.05  # [s] of the class
HORIZON, STEP = 5.5, 0.1  # [s] of predictions: half a second more than the longest trajectory
DIAMETER = 0.6  # [m] of a pedestrian
BEYOND = 50.0  # [m] by which the lane goes on straight, so that nothing is planned to end where the map does


class Person(NamedTuple):
    """Where a pedestrian is [m] and how it moves [m/s], in the map."""

    x: float
    y: float
    vx: float
    vy: float


class Driver:
    """What the planner does with one tick after the other, of one episode after the other."""

    def __init__(self) -> None:
        self._scenarios = {each.number: each for each in load_scenarios([*scenario_files(), *further_files()])}
        self._controller = fp.make_controller("mpc", vehicle())
        self._episode = (0, 0)

    def control(
        self, state: np.void, people: Iterable[Person], period: float, age: float = 0.0
    ) -> tuple[float, float, float]:
        """Return (steer, throttle, brake).

        :param state: EPISODE of this tick; only its vehicle, scenario and frame are looked at.
        :param people: pedestrians as they were `age` [s] ago.
        :param period: from tick to tick [s].
        """
        if state["status"] == IDLE:  # between two episodes
            return 0.0, 0.0, 0.0
        episode = int(state["scenario"]), int(state["episode"])
        if episode != self._episode:
            self._episode = episode
            self.begin(self._scenarios[episode[0]])
        names = ("x", "y", "heading", "speed", "acceleration", "curvature")
        ego = fp.EgoState(*(float(state[f"vehicle_{name}"]) for name in names))
        return self.follow(ego, people, int(state["frame"]), period, age)

    def follow(
        self, ego: fp.EgoState, people: Iterable[Person], frame: int, period: float, age: float = 0.0
    ) -> tuple[float, float, float]:
        """Return (steer, throttle, brake) at a frame of the episode that has begun, with a new plan every `HOLD`."""
        now = frame * period
        if frame % HOLD == 0:
            walking = [predicted(number, person, age) for number, person in enumerate(people)]
            self._plan, self._since = self._planner.step(now, ego, self._parked + walking).trajectory, now
        command = self._controller.compute(ego, self._plan, now - self._since)
        steer = max(-1.0, min(1.0, command.steer / MAX_STEERING_ANGLE))
        throttle = max(0.0, min(1.0, command.accel / MAX_ACCELERATION))
        return steer, throttle, max(0.0, min(1.0, -command.accel / MAX_DECELERATION))

    def begin(self, scenario: Scenario) -> None:
        """Begin an episode."""
        self._planner = planner_for(scenario)
        self._controller.reset()
        self._parked = [parked(-1 - number, *place) for number, place in enumerate(scenario.parked)]


class PlannerDriver:
    """The planner as a class for `--ads-class`; with perception it takes what it sees for the present."""

    def __init__(self) -> None:
        self._driver = Driver()

    def reset(self, begin: Any) -> None:
        """Begin an episode."""
        self._driver.begin(begin.scenario)
        self._frame, self._speed = 0, math.nan

    def act(self, observation: Any) -> tuple[float, float, float]:
        """Return steer, throttle and brake."""
        x, y, yaw, speed, yaw_rate, *_ = observation.vehicle
        acceleration = 0.0 if self._frame == 0 else (speed - self._speed) / TICK
        curvature = yaw_rate / speed if speed > 0.0 else 0.0
        people = [
            Person(each.x, each.y, each.speed * math.cos(each.yaw), each.speed * math.sin(each.yaw))
            for each in observation.pedestrians
        ]
        ego = fp.EgoState(x, y, yaw, speed, acceleration, curvature)
        answer = self._driver.follow(ego, people, self._frame, TICK)
        self._frame, self._speed = self._frame + 1, speed
        return answer


def vehicle() -> fp.VehicleParams:
    """Return the world's vehicle: a bicycle whose centre, rather than its rear axle, moves along the heading."""
    params = fp.VehicleParams()
    params.length, params.width = VEHICLE_LENGTH, VEHICLE_WIDTH
    params.wheelbase, params.rear_axle_to_center = WHEELBASE, 0.0
    params.max_steer, params.max_steer_rate = MAX_STEERING_ANGLE, 10.0  # [rad], [rad/s]: the world's turns at once
    params.max_accel, params.max_decel, params.max_lat_accel = 3.0, 8.0, 3.0  # [m/s2]
    return params


def planner_for(scenario: Scenario) -> fp.LocalPlanner:
    """Return the planner, which may move to the side within the lane of a scenario but not leave it."""
    config = fp.LocalPlannerConfig()
    config.desired_speed = CRUISE
    config.path.num_left_lanes = config.path.num_right_lanes = 0
    config.path.lane_width = scenario.vehicle.lane_width
    planner = fp.LocalPlanner(config, vehicle())
    planner.set_reference_path(*lane(scenario).T)
    return planner


def lane(scenario: Scenario) -> NDArray[np.float64]:
    """Return the centre line of a scenario's lane and `BEYOND`, float64[N, 2] [m]."""
    points = scenario.vehicle.path.points
    last = points[-1] - points[-2]
    return np.vstack([points, points[-1] + np.arange(5.0, BEYOND, 5.0)[:, None] * last / np.hypot(*last)])


def predicted(number: int, person: Person, age: float) -> fp.Obstacle:
    """Return a pedestrian who goes on as it was seen to do `age` [s] ago."""
    heading, speed = math.atan2(person.vy, person.vx), math.hypot(person.vx, person.vy)
    x, y = person.x + age * person.vx, person.y + age * person.vy
    return fp.predict_constant_velocity(number, x, y, heading, speed, DIAMETER, DIAMETER, HORIZON, STEP)


def parked(number: int, x: float, y: float, heading: float, length: float, width: float) -> fp.Obstacle:
    """Return a vehicle that stands [m, rad]."""
    times = np.arange(0.0, HORIZON, STEP)
    motion = (np.full(len(times), value) for value in (x, y, heading))
    return fp.Obstacle.from_arrays(number, length, width, times, *motion, is_static=True)


def people_of(state: NDArray[np.void]) -> list[Person]:
    """Return the pedestrians of a tick as they truly are, of EPISODE[P]: a row each, idle where there are fewer."""
    names = ("x", "y", "vx", "vy")
    return [Person(*(float(row[f"pedestrian_{name}"]) for name in names)) for row in state if row["status"] != IDLE]


def people_seen(objects: "PointCloud2") -> list[Person]:
    """Return the pedestrians of a list of objects; docs/ads.md says what a point holds."""
    return [Person(x, y, vx, vy) for x, y, _, vx, vy, _ in struct.iter_unpack("<5fI", bytes(objects.data))]


def drive(latency: float | None) -> None:
    """Answer every tick of the world until stopped.

    :param latency: by how much objects come late at most [s]; None: the pedestrians are those of the world's state.
    """
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from sensor_msgs.msg import PointCloud2

    from vpsci_msgs.msg import VehicleControl, WorldState

    rclpy.init()
    node, driver = rclpy.create_node("motion_planner"), Driver()
    command = node.create_publisher(VehicleControl, "vehicle/cmd_control", 10)
    waiting: list[StateContent] = []  # the tick that objects have not come for
    seen: list[PointCloud2] = []  # the latest ones

    def on_state(data: bytes) -> None:
        waiting[:] = [read_world_state(data)]
        answer()

    def on_objects(message: PointCloud2) -> None:
        seen[:] = [message]
        answer()

    def answer() -> None:
        age = 1e-9 * waiting[0].header.at - seconds(seen[0]) if waiting and seen else 0.0
        if not waiting or (latency is not None and (not seen or age > latency + 0.001)):
            return
        header, tick, period = waiting.pop()
        state = tick.state
        people = people_of(state) if latency is None else people_seen(seen[0])
        steer, throttle, brake = driver.control(state[0], people, period, age)
        answer = VehicleControl(tick=tick.number, steer=steer, throttle=throttle, brake=brake)
        answer.header.stamp.sec, answer.header.stamp.nanosec = header.seconds, header.nanoseconds
        answer.header.frame_id = header.frame_id
        if rclpy.ok():  # it was not shut down while it planned
            command.publish(answer)

    node.create_subscription(WorldState, "world/state", on_state, 10, raw=True)
    if latency is not None:
        node.create_subscription(PointCloud2, "perception/objects", on_objects, 10)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    rclpy.try_shutdown()


def seconds(message: "PointCloud2") -> float:
    """Return the simulated time of a message's stamp [s]."""
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def main() -> None:
    """Drive."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--objects", type=float, metavar="LATENCY", help="take /perception/objects, which come so late [s] at most"
    )
    drive(parser.parse_args().objects)


if __name__ == "__main__":
    main()
