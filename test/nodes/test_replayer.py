"""The replayer publishes a bag as it was recorded: whole, in part, paused and stepped, with a clock."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

from vpsci_msgs.msg import WorldState
from vpsci_ros.bags.episodes import bag_episodes
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.replayer import Replayer
from vpsci_ros.nodes.topics import RECORDING

TYPES = {"/world/state": WorldState, "/vehicle/odometry": Odometry, "/clock": Clock}


class Stage:
    """A listener, and a replayer with these parameters, spun together."""

    def __init__(self, context: Context) -> None:
        from rclpy import create_node

        self.context = context
        self.listener = create_node("listener", context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.listener)
        self.heard: dict[str, list[bytes]] = {name: [] for name in TYPES}
        for name, kind in TYPES.items():
            self.listener.create_subscription(kind, name, self.heard[name].append, RECORDING, raw=True)
        self.replayer: Replayer

    def play(self, recording: Path, **values: Any) -> None:
        given = {"bag": str(recording), "rate": 0.0} | values
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        self.replayer = Replayer(context=self.context, parameter_overrides=overrides)
        self.executor.add_node(self.replayer)

    def spin(self, until: Callable[[], bool], seconds: float = 120.0) -> None:
        deadline = time.monotonic() + seconds
        while not until():
            assert time.monotonic() < deadline, "waited in vain"
            self.executor.spin_once(timeout_sec=0.05)

    def to_the_end(self, expected: dict[str, int]) -> None:
        self.spin(lambda: self.replayer.finished)
        self.spin(lambda: all(len(self.heard[name]) >= count for name, count in expected.items()))

    def call(self, kind: Any, name: str, request: Any) -> Any:
        client = self.listener.create_client(kind, f"replayer/{name}")
        self.spin(client.service_is_ready)
        future = client.call_async(request)
        self.spin(future.done)
        return future.result()


@pytest.fixture
def stage(context: Context) -> Iterator[Stage]:
    stage = Stage(context)
    yield stage
    stage.executor.shutdown()
    if hasattr(stage, "replayer"):
        stage.replayer.destroy_node()
    stage.listener.destroy_node()


def recorded(bag: Path, topic: str, start: int = 0) -> list[bytes]:
    return [raw.data for raw in Bag(bag).messages([topic], start)]


def test_every_message_comes_as_recorded_with_a_clock_for_a_bag_without_one(stage: Stage, own_bag: Path) -> None:
    states = recorded(own_bag, "/world/state")
    stage.play(own_bag)
    stage.to_the_end({"/world/state": len(states), "/clock": len(states)})
    assert stage.heard["/world/state"] == states
    assert stage.heard["/vehicle/odometry"] == recorded(own_bag, "/vehicle/odometry")
    stamps = [data[4:12] for data in states]
    assert [data[4:12] for data in stage.heard["/clock"]] == stamps


def test_it_begins_with_the_episode_that_is_named_and_leaves_topics_out(stage: Stage, own_bag: Path) -> None:
    episode = next(one for one in bag_episodes(Bag(own_bag)) if one.name == "6:4")
    states = recorded(own_bag, "/world/state", episode.start_time)
    stage.play(own_bag, first_episode="6:4", leave_out=["/vehicle/odometry", "/clock"])
    stage.to_the_end({"/world/state": len(states)})
    assert stage.heard["/world/state"] == states
    assert stage.heard["/vehicle/odometry"] == stage.heard["/clock"] == []


def test_only_the_named_topics_are_published(stage: Stage, own_bag: Path) -> None:
    odometry = recorded(own_bag, "/vehicle/odometry")
    stage.play(own_bag, topics=["/vehicle/odometry"])
    stage.to_the_end({"/vehicle/odometry": len(odometry)})
    assert stage.heard["/vehicle/odometry"] == odometry
    assert stage.heard["/world/state"] == []


def test_paused_it_goes_on_tick_by_tick_and_then_by_itself(stage: Stage, own_bag: Path) -> None:
    stage.play(own_bag, paused=True)
    stage.spin(lambda: stage.replayer._begun)
    for tick in range(1, 4):
        response = stage.call(Trigger, "step", Trigger.Request())
        assert response.success
        assert f"at {(tick - 1) * 0.05:.3f} s" in response.message
        stage.spin(lambda tick=tick: len(stage.heard["/world/state"]) == tick)
    assert stage.call(SetBool, "pause", SetBool.Request(data=False)).message.startswith("playing")
    refused = stage.call(Trigger, "step", Trigger.Request())
    assert not refused.success
    stage.to_the_end({"/world/state": len(recorded(own_bag, "/world/state"))})


def test_the_rate_sets_the_pace_and_changes_on_the_way(stage: Stage, own_bag: Path) -> None:
    stage.play(own_bag, rate=0.001)
    stage.spin(lambda: stage.replayer._begun and len(stage.heard["/world/state"]) == 1)
    assert stage.replayer._sent < 10  # the second tick is 50 s away
    (result,) = stage.replayer.set_parameters([Parameter("rate", value=0.0)])
    assert result.successful
    stage.to_the_end({"/world/state": len(recorded(own_bag, "/world/state"))})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"first_episode": "9"}, "episode 9: not in the bag"),
        ({"topics": ["/nothing"]}, "no topic /nothing; it has"),
        ({"bag": "nowhere"}, "nowhere: no such folder"),
    ],
)
def test_what_cannot_be_played_is_said_at_once(
    stage: Stage, own_bag: Path, values: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidInput, match=message):
        stage.play(own_bag, **values)


def test_a_bag_whose_types_are_not_installed_is_refused(stage: Stage, tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "bag", [BagTopic("/lidar", "velodyne_msgs/msg/VelodyneScan", "uint8 x\n", "RIHS01_0")])
    bag.write("/lidar", b"\x00\x01\x00\x00\x02", 0, 0)
    bag.close({})
    with pytest.raises(InvalidInput, match="none of the message types of /lidar is installed"):
        stage.play(tmp_path / "bag")
