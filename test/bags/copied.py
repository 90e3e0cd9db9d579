"""What another tool would have recorded of a bag's topics."""

from pathlib import Path

from rosbags.rosbag2 import StoragePlugin, Writer

from vpsci_ros.bags.reader import Bag
from vpsci_ros.wire.decoder import known_types

STATES = ("/world/state", "/safety/state")


def received(time: int) -> int:
    """Return when the copying tool received what is logged at `time`, both in [ns]."""
    return 1_700_000_000 * 10**9 + time // 2


def copied(bag: Path, folder: Path, topics: tuple[str, ...] = STATES, *, untimed: int = 0) -> Path:
    """Record these topics again as `ros2 bag record` does, with receipt times that run twice as fast.

    :param untimed: so many of the first messages are logged at 0, as before the first `/clock` with `use_sim_time`.
    """
    store = known_types()
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.open()
    connections = {}
    for number, raw in enumerate(Bag(bag).messages(topics, ordered=True)):
        if raw.topic not in connections:
            connections[raw.topic] = writer.add_connection(raw.topic, raw.type, typestore=store)
        time = 0 if number < untimed else received(raw.time)
        writer.write(connections[raw.topic], time, raw.data)
    writer.close()
    return folder
