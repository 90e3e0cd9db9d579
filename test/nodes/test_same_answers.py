"""A pedestrian answers a recorded car to the bit alike in the world's loop, as `Pedestrian` and in the graph."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry
from nodes.stage import Stage, overrides
from rclpy.context import Context
from rclpy.experimental import EventsExecutor

from vpsci_msgs.msg import WorldState
from vpsci_ros import Pedestrian, Vehicle, Walker
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.nodes.agent_policy import PedestrianPolicy
from vpsci_ros.nodes.safety_monitor import SafetyMonitor
from vpsci_ros.nodes.world_simulator import WorldSimulator
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.policy_config import PolicyConfig
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.world import RUNNING, World, WorldConfig, load_scenario
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.tick import Actions

SEED, SCENARIO, TIME = 7, 1, 8.0
DRIVERS = {"vehicle_driver": "external", "pedestrian_driver": "policy", "episode_time": TIME}
CAR = ("x", "y", "heading", "speed", "curvature", "acceleration")


class Seen(NamedTuple):
    """A tick: the car, the pedestrian, and whether the policy holds control."""

    car: Vehicle
    walker: Walker
    controlled: bool


def recorded_car() -> list[float]:
    """Return the accelerations [m/s2] of the first recorded car of right turns, one for each tick of 0.05 s."""
    table = read_near_misses("right_turns/dev")
    speed = table.filter(table["interaction"] == table["interaction"][0])["veh_speed"].to_numpy()
    gains = np.repeat(np.diff(speed) / 0.1, 2)
    return np.concatenate([gains, np.zeros(round(TIME / 0.05))]).tolist()


def seen_in(record: Any) -> Seen:
    car = Vehicle(*(float(record(f"vehicle_{name}")) for name in CAR))
    walker = Walker(*(float(record(f"pedestrian_{name}")) for name in Walker._fields))
    return Seen(car, walker, bool(record("controlled")))


@pytest.fixture(scope="module")
def in_the_loop() -> list[Seen]:
    """Every tick of an episode in the world's loop, in one process."""
    world = World(WorldConfig(**DRIVERS), [load_scenario(SCENARIO)], [(SCENARIO, 0)], 1, SEED)
    agents = policies(load_policy("people"), world, {"pedestrian": PolicyConfig(seed=SEED)})
    gains = recorded_car()
    steps = Loop(world, agents).ticks(lambda tick, _: Actions(np.array([[gains[int(tick.state["frame"][0])], 0.0]])))
    states = (step.tick.state[0] for step in steps)
    return [seen_in(state.__getitem__) for state in states if state["status"] == RUNNING]


def test_the_recorded_car_makes_the_pedestrian_react(in_the_loop: list[Seen]) -> None:
    assert sum(seen.controlled for seen in in_the_loop) > 40


def test_as_an_object_it_walks_to_the_bit_as_in_the_loop(in_the_loop: list[Seen]) -> None:
    pedestrian = Pedestrian("people", seed=SEED, scenario=SCENARIO, config=WorldConfig(episode_time=TIME))
    own, controlled = pedestrian.start, False
    for frame, seen in enumerate(in_the_loop):
        assert (own, controlled) == (seen.walker, seen.controlled), f"frame {frame}"
        walk = pedestrian.step(own, {"car": seen.car})
        own, controlled = Walker(*walk[:4]), walk.controlled


class Graph(Stage):
    """World, monitor, pedestrian and a driving system in one process, over messages."""

    def __init__(self, context: Context) -> None:
        settings = {"scenarios": [SCENARIO], "episodes": 1, "batch": 1, "seed": SEED} | DRIVERS
        self.world = WorldSimulator(context=context, parameter_overrides=overrides(**settings))
        walks = PedestrianPolicy(context=context, parameter_overrides=overrides(weights="people", seed=SEED))
        super().__init__(
            context, self.world, SafetyMonitor(context=context), walks, peer="ads", executor=EventsExecutor
        )
        self.seen: dict[int, Seen] = {}
        self._gains = recorded_car()
        self._commands = self.peer.create_publisher(AccelStamped, "vehicle/cmd_accel", 1000)
        self.peer.create_subscription(Odometry, "vehicle/odometry", self._on_odometry, 1000)
        self.peer.create_subscription(WorldState, "world/state", self._on_state, 1000)

    def _on_odometry(self, odometry: Odometry) -> None:
        stamp = odometry.header.stamp
        frame = round((stamp.sec + 1e-9 * stamp.nanosec) / 0.05)  # the only episode begins at tick 0
        command = AccelStamped(header=odometry.header)
        command.accel.linear.x = self._gains[frame]
        self._commands.publish(command)

    def _on_state(self, message: WorldState) -> None:
        if message.status[0] == RUNNING:
            assert message.tick == message.frame[0]
            self.seen[message.frame[0]] = seen_in(lambda name: getattr(message, name)[0])


@pytest.fixture
def graph(context: Context, closed: Callable[[Any], Any]) -> Graph:
    return closed(Graph(context))


def test_in_the_graph_it_walks_to_the_bit_as_in_the_loop(graph: Graph, in_the_loop: list[Seen]) -> None:
    graph.spin_until(lambda: graph.world.finished and len(graph.seen) == len(in_the_loop))
    for frame, seen in enumerate(in_the_loop):
        assert graph.seen[frame] == seen, f"frame {frame}"
