"""Recorded graphs read back without ROS: tick by tick, from the definitions that the bag itself carries."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from vpsci_ros.data.episode_frames import EpisodeBatch, EpisodeFrames
from vpsci_ros.data.mcap_file import McapFile, RawMessage
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.state import EPISODE

WORLD = "/world/state"
SAFETY = "/safety/state"
_TYPES = {WORLD: "vpsci_msgs/msg/WorldState", SAFETY: "vpsci_msgs/msg/SafetyState"}
_NEEDED = (
    *("scenario", "episode", "frame", "status", "outcome"),
    *("vehicle_x", "vehicle_y", "vehicle_heading", "vehicle_speed"),
    *("pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy"),
)
_PATIENCE = 1000  # ticks for which the monitor's answer may come later in the file than the world's message


class Tick(NamedTuple):
    """The world at one tick and what the safety monitor said of it.

    state: EPISODE[B], fields that the message does not carry are 0. curvttc float64[B] [s], distance float64[B] [m]:
    NaN where the bag holds no answer to this tick.
    """

    tick: int
    period: float
    state: NDArray[np.void]
    curvttc: NDArray[np.float64]
    distance: NDArray[np.float64]


def bag_files(folder: str | Path) -> list[Path]:
    """Return the MCAP files of a bag in the order of their names.

    :raises InvalidInput: no such folder, or none in it.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InvalidInput(f"{folder}: no such folder; expected a rosbag2 folder with an .mcap file")
    files = sorted(path for path in folder.glob("*.mcap") if not path.name.startswith("."))
    if not files:
        raise InvalidInput(f"{folder}: no .mcap file; expected a rosbag2 folder as the recorder writes it")
    return files


def read_bag(folder: str | Path, *, recover: bool = False) -> Iterator[Tick]:
    """Yield every tick of a bag in order.

    :param recover: read what is whole of a bag that was not closed or is damaged, instead of refusing it.
    :raises InvalidInput: no bag, a bag of something else, one without a tick, or (unless `recover`) one that breaks
        off or is damaged.
    """
    folder = Path(folder)
    answers: dict[int, Any] = {}
    waiting: dict[int, Any] = {}
    ticks = 0
    for topic, message in _messages(folder, recover):
        (waiting if topic == WORLD else answers)[int(message.tick)] = message
        for tick in list(waiting):
            if tick not in answers and len(waiting) <= _PATIENCE:
                break
            ticks += 1
            yield _tick(folder, waiting.pop(tick), answers.pop(tick, None))
    for tick in list(waiting):
        ticks += 1
        yield _tick(folder, waiting.pop(tick), answers.pop(tick, None))
    if ticks == 0:
        raise InvalidInput(f"{folder}: the bag holds no message of {WORLD}; nothing was recorded")


def read_episodes(folder: str | Path, *, recover: bool = False) -> Iterator[EpisodeBatch]:
    """Yield the episodes of a bag as they end, through the collector that the simulation uses.

    :raises InvalidInput: see `read_bag`.
    """
    frames: EpisodeFrames | None = None
    for tick in read_bag(folder, recover=recover):
        frames = frames or EpisodeFrames(len(tick.state))
        batch = frames.add(tick.state, tick.curvttc, tick.distance)
        if len(batch):
            yield batch


def _messages(folder: Path, recover: bool) -> Iterator[tuple[str, Any]]:
    decode = Decoder()
    for path in bag_files(folder):
        file = McapFile(path, strict=not recover)
        seen: set[str] = set()
        for raw in file.messages():
            topic = raw.channel.topic
            seen.add(topic)
            if topic in _TYPES:
                if raw.schema.name != _TYPES[topic]:
                    raise InvalidInput(f"{path}: expected {_TYPES[topic]} on {topic}, got {raw.schema.name}")
                yield topic, decode(raw, path)
        if seen and WORLD not in seen:
            raise InvalidInput(
                f"{path}: no message of {WORLD}, so this is no bag of a vpsci graph; it has {', '.join(sorted(seen))}"
            )


class Decoder:
    """Turns serialized messages into objects, by the definitions embedded in the bag."""

    def __init__(self) -> None:
        self._store = get_typestore(Stores.EMPTY)

    def __call__(self, raw: RawMessage, path: Path) -> Any:
        """Return the message as an object whose numeric sequences are arrays.

        :raises InvalidInput: another encoding than CDR, or a definition or message that cannot be read.
        """
        name = raw.schema.name
        if raw.channel.message_encoding != "cdr" or raw.schema.encoding != "ros2msg":
            raise InvalidInput(
                f"{path}: {raw.channel.topic} holds {raw.channel.message_encoding} described by {raw.schema.encoding}; "
                "expected cdr described by ros2msg"
            )
        try:
            if name not in self._store.fielddefs:
                types = get_types_from_msg(raw.schema.data.decode(), name)
                self._store.register({key: kind for key, kind in types.items() if key not in self._store.fielddefs})
            return self._store.deserialize_cdr(raw.message.data, name)
        except Exception as error:  # noqa: BLE001  rosbags raises whatever its parser meets
            time = raw.message.log_time
            raise InvalidInput(f"{path}: {name} at {time} ns on {raw.channel.topic} is not readable: {error}") from None


def _tick(folder: Path, world: Any, safety: Any | None) -> Tick:
    missing = [name for name in _NEEDED if not hasattr(world, name)]
    if missing:
        raise InvalidInput(f"{folder}: {WORLD} has no field {', '.join(missing)}; it is of another version")
    batch = len(world.scenario)
    state = np.zeros(batch, EPISODE)
    for name in EPISODE.names or ():
        if hasattr(world, name):
            state[name] = _sized(folder, WORLD, name, getattr(world, name), batch)
    unknown = np.full(batch, np.nan)
    curvttc = unknown if safety is None else _sized(folder, SAFETY, "curvttc", safety.curvttc, batch)
    distance = unknown if safety is None else _sized(folder, SAFETY, "distance", safety.distance, batch)
    return Tick(int(world.tick), float(world.dt), state, curvttc, distance)


def _sized(folder: Path, topic: str, name: str, values: NDArray[Any], batch: int) -> NDArray[Any]:
    if len(values) != batch:
        raise InvalidInput(f"{folder}: {topic}.{name} has {len(values)} entries, expected {batch}; the bag is damaged")
    return values
