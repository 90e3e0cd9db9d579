"""Bags written without ROS, for the tests of this room."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bags.copied import copied
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.world.state import EPISODE

MESSAGES = Path(__file__).parents[2] / "msg_defs" / "msg"
SimulatedTick = tuple[NDArray[np.void], NDArray[np.float64], NDArray[np.float64]]


@pytest.fixture(scope="session")
def foreign(own_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The states of `own_bag` as another tool would have recorded them; not to be changed."""
    return copied(own_bag, tmp_path_factory.mktemp("foreign") / "bag")


@pytest.fixture(scope="session")
def write_bag() -> Callable[..., Path]:
    """Write ticks to a bag as the recorder does."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in sorted(MESSAGES.glob("*.msg")):
        store.register(get_types_from_msg(path.read_text(), f"vpsci_msgs/msg/{path.stem}"))

    def write(folder: Path, ticks: list[SimulatedTick], *, unanswered: tuple[int, ...] = ()) -> Path:
        topics = []
        for name, message_name in (("/world/state", "WorldState"), ("/safety/state", "SafetyState")):
            kind = f"vpsci_msgs/msg/{message_name}"
            definition, _ = store.generate_msgdef(kind, ros_version=2)
            topics.append(BagTopic(name, kind, definition, store.hash_rihs01(kind)))
        bag = BagWriter(folder, topics, chunk_size=4096)
        header_type, stamp_type = (store.types[n] for n in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
        for tick, (state, curvttc, distance) in enumerate(ticks):
            time = tick * 50_000_000
            header = header_type(stamp=stamp_type(sec=time // 10**9, nanosec=time % 10**9), frame_id="map")
            world = store.types["vpsci_msgs/msg/WorldState"]
            own = {name: np.ascontiguousarray(state[name]) for name in EPISODE.names}
            fields = [name for name, _ in store.fielddefs["vpsci_msgs/msg/WorldState"][1]]
            arrays = {name: own.get(name, np.ones(len(state), np.uint8)) for name in fields[3:]}
            message = world(header=header, tick=tick, dt=0.05, **arrays)
            bag.write("/world/state", bytes(store.serialize_cdr(message, world.__msgtype__)), time, time)
            if tick not in unanswered:
                safety = store.types["vpsci_msgs/msg/SafetyState"]
                critical = (curvttc < 5.0).astype(np.uint8)
                answer = safety(header=header, tick=tick, curvttc=curvttc, distance=distance, critical=critical)
                bag.write("/safety/state", bytes(store.serialize_cdr(answer, safety.__msgtype__)), time, time)
        bag.close({"seed": "7"})
        return folder

    return write
