"""The replayer publishes a bag as it was recorded: whole and in part, with a clock."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from nav_msgs.msg import Odometry
from nodes.stage import Stage, overrides
from rclpy.context import Context
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from vpsci_msgs.msg import WorldState
from vpsci_ros.bags.episodes import bag_episodes
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.run_record import bag_run
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.recorder import Recorder
from vpsci_ros.nodes.replayer import Replayer
from vpsci_ros.nodes.topics import LATCHED, RECORDING
from vpsci_ros.wire.decoder import describe

SHIPPED = Path(__file__).resolve().parents[2] / "bags/LocationA_PedCross_S-N"
TYPES = {"/world/state": WorldState, "/vehicle/odometry": Odometry, "/clock": Clock}


class Player(Stage):
    """A listener, and a replayer with these parameters, spun together."""

    def __init__(self, context: Context) -> None:
        super().__init__(context, peer="listener")
        self.heard: dict[str, list[bytes]] = {name: [] for name in TYPES}
        for name, kind in TYPES.items():
            self.peer.create_subscription(kind, name, self.heard[name].append, RECORDING, raw=True)
        self.replayer: Replayer

    def play(self, recording: Path, **values: Any) -> None:
        given = {"bag": str(recording), "rate": 0.0} | values
        self.replayer = self.add(Replayer(context=self.context, parameter_overrides=overrides(**given)))

    def to_the_end(self, expected: dict[str, int]) -> None:
        self.spin_until(lambda: self.replayer.finished)
        self.spin_until(lambda: all(len(self.heard[name]) >= count for name, count in expected.items()))


@pytest.fixture
def player(context: Context, closed: Callable[[Any], Any]) -> Player:
    return closed(Player(context))


def recorded(bag: Path, topic: str, start: int = 0) -> list[bytes]:
    return [raw.data for raw in Bag(bag).messages([topic], start)]


def test_every_message_comes_as_recorded_with_a_clock_for_a_bag_without_one(player: Player, short_bag: Path) -> None:
    states = recorded(short_bag, "/world/state")
    player.play(short_bag)
    player.to_the_end({"/world/state": len(states), "/clock": len(states)})
    assert player.heard["/world/state"] == states
    assert player.heard["/vehicle/odometry"] == recorded(short_bag, "/vehicle/odometry")
    stamps = [data[4:12] for data in states]
    assert [data[4:12] for data in player.heard["/clock"]] == stamps


def test_it_begins_with_the_episode_that_is_named(player: Player, short_bag: Path) -> None:
    episode = next(one for one in bag_episodes(Bag(short_bag)) if one.listed.name == "6:4")
    states = recorded(short_bag, "/world/state", episode.start_time)
    player.play(short_bag, first_episode="6:4")
    player.to_the_end({"/world/state": len(states)})
    assert player.heard["/world/state"] == states


def test_from_a_later_episode_on_it_first_gives_what_latched_topics_held_then(
    player: Player, short_bag: Path, tmp_path: Path
) -> None:
    """One profile of depth 1, so the latest of the messages before the episode; the clock never runs backwards."""
    episode = next(one for one in bag_episodes(Bag(short_bag)) if one.listed.name == "6:4")
    texts = {at: serialize_message(String(data=f"at {at}")) for at in (0, 10, episode.start_time + 1)}
    kinds = {"/world/state": "vpsci_msgs/msg/WorldState", "/note": "std_msgs/msg/String"}
    topics = [BagTopic(name, kind, *describe(kind), latched=name == "/note") for name, kind in kinds.items()]
    messages = [("/world/state", raw.time, raw.data) for raw in Bag(short_bag).messages(["/world/state"])]
    messages += [("/note", at, data) for at, data in texts.items()]
    bag = BagWriter(tmp_path / "bag", topics)
    for topic, at, data in sorted(messages, key=lambda message: message[1]):
        bag.write(topic, data, at, 0)
    bag.close({})
    notes: list[bytes] = []
    player.peer.create_subscription(String, "/note", notes.append, LATCHED, raw=True)
    player.play(tmp_path / "bag", first_episode="6:4")
    player.to_the_end({"/world/state": len(recorded(short_bag, "/world/state", episode.start_time))})
    player.spin_until(lambda: len(notes) == 2)
    assert notes == [texts[10], texts[episode.start_time + 1]]
    times = [deserialize_message(data, Clock).clock for data in player.heard["/clock"]]
    stamps = [time.sec * 10**9 + time.nanosec for time in times]
    assert stamps[0] == episode.start_time
    assert stamps == sorted(stamps)
    assert player.replayer.figures()["messages_published"] == len(player.heard["/world/state"]) + 2


def test_a_second_recording_of_a_replay_verifies_as_the_first(
    context: Context, closed: Callable[[Any], Any], tmp_path: Path
) -> None:
    stage = closed(Stage(context, peer="listener"))
    recorder = stage.add(Recorder(context=context, parameter_overrides=overrides(bag=str(tmp_path / "second"))))
    given = {"bag": str(SHIPPED), "rate": 0.0, "peers": ["recorder"]}
    replayer = stage.add(Replayer(context=context, parameter_overrides=overrides(**given)))
    stage.spin_until(lambda: replayer.finished)
    replayer.close()
    first, second = Bag(SHIPPED), tmp_path / "second"
    stage.spin_until(lambda: recorder.figures()["messages_written"] >= sum(r.messages for r in first.topics().values()))
    recorder.close()
    assert bag_run(Bag(second)).parameters.keys() >= bag_run(first).parameters.keys() - {"recorder"}
    verified = verify_bag(second)
    assert (verified.difference, verified.uncompared) == ("", ())
    assert verified.ticks == len(recorded(SHIPPED, "/world/state"))


def test_the_rate_sets_the_pace(player: Player, short_bag: Path) -> None:
    player.play(short_bag, rate=0.001)
    player.spin_until(lambda: len(player.heard["/world/state"]) == 1)
    assert player.replayer.figures()["messages_published"] < 10  # the second tick is 50 s away


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"first_episode": "9"}, "no episode of the bag is as chosen"),
        ({"bag": "nowhere"}, "nowhere: no such folder"),
    ],
)
def test_what_cannot_be_played_is_said_at_once(
    player: Player, short_bag: Path, values: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidInput, match=message):
        player.play(short_bag, **values)


def test_a_bag_whose_types_are_not_installed_is_refused(player: Player, tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "bag", [BagTopic("/lidar", "velodyne_msgs/msg/VelodyneScan", "uint8 x\n", "RIHS01_0")])
    bag.write("/lidar", b"\x00\x01\x00\x00\x02", 0, 0)
    bag.close({})
    with pytest.raises(InvalidInput, match="none of the message types of /lidar is installed"):
        player.play(tmp_path / "bag")
