"""`vpsci bag` info, verify and export: bags of the graph, of other tools, damaged and empty ones."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest
from typer.testing import CliRunner

from vpsci_ros.bags.info import bag_info
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.run_record import NODE, bag_run, node_record
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.cli.bag import bag_app
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.decoder import RawMessage, known_types
from vpsci_ros.wire.layout import WORLD

SHIPPED = Path(__file__).parents[2] / "bags" / "LocationA_PedCross_N-S"


def run(*arguments: object):
    return CliRunner().invoke(bag_app, [str(argument) for argument in arguments])


def changed(
    bag: Path,
    folder: Path,
    *,
    edit: Callable[[list[RawMessage]], list[RawMessage]] = list,
    nodes: dict[str, dict] | None = None,
    **run: object,
) -> Path:
    """Write a bag again: other messages, or other parameters of the nodes."""
    source = Bag(bag)
    topics = {}
    for raw in source.messages():
        topics.setdefault(raw.topic, BagTopic(raw.topic, raw.type, raw.definition, "RIHS01_0"))
    writer = BagWriter(folder, list(topics.values()))
    parameters = bag_run(source).parameters if nodes is None else nodes
    for node, values in parameters.items():
        writer.describe(NODE, node_record(node, values | (run if node == "world_simulator" else {})))
    for raw in edit(list(source.messages())):
        writer.write(raw.topic, raw.data, raw.time, 0)
    writer.close({})
    return folder


def tick_of(raw: RawMessage) -> int:
    return raw.time // 50_000_000


def with_state(raw: RawMessage, **values: float) -> RawMessage:
    """A message, a WorldState mostly, in which numbers are added to its fields, or are NaN."""
    store = known_types()
    message = store.deserialize_cdr(raw.data, raw.type)
    for name, value in values.items():
        setattr(message, name, getattr(message, name) + value)
    return raw._replace(data=bytes(store.serialize_cdr(message, raw.type)))


# ---- info


def test_info_tells_topics_rates_of_simulated_time_episodes_and_counts(own_bag: Path) -> None:
    info = bag_info(own_bag)
    assert json.loads(json.dumps(info)) == info
    topics = {topic["name"]: topic for topic in info["topics"]}
    assert topics["/world/state"]["rate"] == pytest.approx(20.0)
    assert topics["/world/state"]["type"] == "vpsci_msgs/msg/WorldState"
    assert topics["/world/state"]["seen"] == topics["/world/state"]["written"] == topics["/world/state"]["messages"]
    assert info["messages_seen"] == info["messages_written"] == info["messages"]
    assert [episode["name"] for episode in info["episodes"]] == ["1:0", "6:4", "1:2"]
    assert sum(info["outcomes"].values()) == 3
    assert info["run"]["parameters"]["world_simulator"]["seed"] == 3
    assert info["missing"] == []


def test_info_of_another_tools_bag_says_what_is_missing(foreign: Path) -> None:
    info = bag_info(foreign)
    assert info["time"] == "of receipt"
    assert [episode["name"] for episode in info["episodes"]] == ["1:0", "6:4", "1:2"]
    assert info["messages_seen"] is None
    assert info["missing"] == [
        "records of episodes: they are found by reading all of the world's states",
        "the nodes' parameters: no verify",
    ]


def test_info_of_a_cut_off_bag_tells_what_is_readable_and_that_it_is_damaged(own_bag: Path, tmp_path: Path) -> None:
    bag = changed(own_bag, tmp_path / "bag")
    (file,) = bag.glob("*.mcap")
    whole = bag_info(bag)["messages"]
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    info = bag_info(bag)
    assert "breaks off" in info["damage"][0]
    assert 0 < info["messages"] < whole


# ---- verify


def test_verify_finds_a_bag_to_be_what_its_parameters_say(own_bag: Path) -> None:
    result = verify_bag(own_bag)
    assert (result.difference, result.notes, result.uncompared) == ("", (), ())
    assert result.episodes == 3
    assert result.ticks == bag_info(own_bag)["topics"][-1]["messages"]
    assert result.values > 20 * result.ticks


def test_verify_names_tick_and_field_of_a_flipped_bit_and_exits_with_1(own_bag: Path, tmp_path: Path) -> None:
    def flipped(raw: RawMessage) -> RawMessage:
        data = bytearray(raw.data)
        data[-5] ^= raw.topic == WORLD and tick_of(raw) == 40
        return raw._replace(data=bytes(data))

    bag = changed(own_bag, tmp_path / "bag", edit=lambda messages: [flipped(raw) for raw in messages])
    result = run("verify", bag)
    assert result.exit_code == 1
    assert "differs at tick 40, /world/state.pedestrian_vy[0]:" in result.stdout
    assert "40 ticks before it are the same" in result.stdout


@pytest.mark.parametrize(
    ("topic", "edit", "status", "said"),
    [
        ("/vehicle/action", lambda raw: [], 3, "not compared: the bag lacks 1 message of /vehicle/action"),
        ("/safety/state", lambda raw: [], 3, "not compared: the bag lacks 1 message of /safety/state"),
        ("/episode/event", lambda raw: [], 3, "not compared: the bag lacks 1 message of /episode/event"),
        ("/episode/event", lambda raw: [with_state(raw, episode=1)], 1, ", /episode/event.episode[0]: "),
        (WORLD, lambda raw: [raw, with_state(raw, tick=2**62)], 1, "the bag goes on"),
        ("/safety/state", lambda raw: [raw, with_state(raw, tick=900_000)], 1, "the bag goes on"),
    ],
)
def test_verify_misses_what_was_taken_out_and_finds_what_was_put_in(
    tmp_path: Path, topic: str, edit: Callable, status: int, said: str
) -> None:
    def edited(messages: list[RawMessage]) -> list[RawMessage]:
        first = next(k for k, raw in enumerate(messages) if raw.topic == topic)
        return [*messages[:first], *edit(messages[first]), *messages[first + 1 :]]

    result = run("verify", changed(SHIPPED, tmp_path / "bag", edit=edited))
    assert result.exit_code == status
    assert said in result.stdout


def test_verify_compares_what_is_left_of_a_cut_off_bag(own_bag: Path, tmp_path: Path) -> None:
    bag = shutil.copytree(own_bag, tmp_path / "bag")
    (file,) = bag.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-500])
    with pytest.raises(InvalidInput, match="not completed"):
        verify_bag(bag)
    result = verify_bag(Bag(bag, recover=True))
    assert result.difference == ""
    assert result.ticks > 100


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        ({}, "does not hold the parameters of the nodes"),
        ({"world_simulator": {"vehicle_driver": "external"}}, "an external system drove the vehicle"),
        (
            {"world_simulator": {"vehicle_driver": "replay", "recorded_bag": "gone/bag"}},
            "replay the bag gone/bag, which is not here",
        ),
        (
            {"world_simulator": {"vehicle_driver": "autopilot", "episode_changes": "gone/changes.json"}},
            "have the head starts in gone/changes.json, which is not here",
        ),
        ({"world_simulator": {"vehicle_driver": "policy"}}, "does not hold the parameters of vehicle_policy"),
        (
            {"world_simulator": {"pedestrian_driver": "autopilot"}, "vehicle_policy": {"weights": "gone.safetensors"}},
            "vehicle_policy acted by weights of SHA-256 .*gone.safetensors: no such file.*--weights",
        ),
    ],
)
def test_verify_says_why_a_bag_cannot_be_simulated_again(
    own_bag: Path, tmp_path: Path, nodes: dict, message: str
) -> None:
    with pytest.raises(InvalidInput, match=f"cannot be simulated again: .*{message}"):
        verify_bag(changed(own_bag, tmp_path / "bag", nodes=nodes))


def test_verify_refuses_weights_of_another_hash(own_bag: Path, tmp_path: Path) -> None:
    world = bag_run(Bag(own_bag)).parameters["world_simulator"] | {"vehicle_driver": "policy"}
    bag = changed(own_bag, tmp_path / "bag", nodes={"world_simulator": world, "vehicle_policy": {"weights": "people"}})
    with pytest.raises(InvalidInput, match="acted by weights people of SHA-256 .*, but .*closed_loop.safetensors has"):
        verify_bag(bag, weights="closed_loop")


# ---- export of a selection


def test_chosen_episodes_are_exported_whatever_the_filters_say(own_bag: Path, tmp_path: Path) -> None:
    chosen = next(e for e in bag_info(own_bag)["episodes"] if e["least_curvttc"] is not None)
    result = run("export", own_bag, "-o", tmp_path / "out", "--episodes", chosen["name"], "--csv")
    assert result.exit_code == 0, result.output
    (path,) = (tmp_path / "out").glob("Location*.parquet")
    assert path.with_suffix(".csv").is_file()
    table = pl.read_parquet(path)
    assert table["count"].unique().to_list() == [chosen["episode"]]
    assert table.height == chosen["end_tick"] - chosen["start_tick"] + 1
