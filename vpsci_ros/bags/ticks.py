"""The ticks of a bag, read without ROS."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.reader import Bag, BagTick, opened
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire import layout
from vpsci_ros.wire.answers import SafetyContent, read_safety_state
from vpsci_ros.wire.decoder import RawMessage, decode, require_cdr
from vpsci_ros.wire.layout import EVENTS, SAFETY, TYPES, WORLD
from vpsci_ros.wire.world_state import StateContent, read_world_state

_PATIENCE = 1000  # ticks for which the monitor's answer may come later in the file than the world's message


def read_bag(
    bag: str | Path | Bag,
    *,
    start: int = 0,
    stop: int = 2**63 - 1,
    take_events: Callable[[NDArray[Any]], None] | None = None,
) -> Iterator[BagTick]:
    """Yield every tick of a bag in order.

    :param start, stop: log times [ns] of the first and the last tick wanted.
    :param take_events: called with the EVENT[n] of each message of events in these times.
    :raises InvalidInput: no bag, a bag of something else, one without a tick, or (unless opened to `recover`) one that
        breaks off or is damaged.
    """
    bag = opened(bag)
    answers: dict[int, SafetyContent] = {}
    waiting: dict[int, tuple[StateContent, int]] = {}
    ticks = 0
    for raw in _messages(bag, (WORLD, SAFETY) if take_events is None else (WORLD, SAFETY, EVENTS), start, stop):
        where = f"{bag.path}: {raw.topic}"
        if take_events is not None and raw.topic == EVENTS:
            take_events(layout.events(decode(raw, bag.path)))
        elif raw.topic == WORLD:
            world = read_world_state(raw.data, where, raw.definition if raw.form == "ros2msg" else "")
            waiting[world.tick.number] = world, raw.time
        else:
            answer = read_safety_state(raw.data, where)
            answers[answer.tick] = answer
        for tick in list(waiting):
            if tick not in answers and len(waiting) <= _PATIENCE:
                break
            ticks += 1
            yield _tick(bag.path, *waiting.pop(tick), answers.pop(tick, None))
    for tick in list(waiting):
        ticks += 1
        yield _tick(bag.path, *waiting.pop(tick), answers.pop(tick, None))
    if ticks == 0:
        raise InvalidInput(f"{bag.path}: {what_is_missing(bag)}")


def what_is_missing(bag: Bag) -> str:
    """Return the reason for which a bag has no ticks."""
    topics = bag.topics()
    if not topics:
        return f"the bag holds no message of {WORLD}; nothing was recorded"
    if WORLD in topics:
        recorded = any(topic.messages for topic in topics.values())
        return f"the bag holds no message of {WORLD}" + ("" if recorded else "; nothing was recorded")
    return f"no message of {WORLD}, so this is no bag of a vpsci graph; it has {', '.join(topics)}"


def _messages(bag: Bag, topics: tuple[str, ...], start: int, stop: int) -> Iterator[RawMessage]:
    for raw in bag.messages(topics, start, stop):
        if (expected := TYPES.get(raw.topic, raw.type)) != raw.type:
            raise InvalidInput(f"{bag.path}: expected {expected} on {raw.topic}, got {raw.type}")
        require_cdr(raw, bag.path)
        yield raw


def _tick(folder: Path, world: StateContent, time: int, safety: SafetyContent | None) -> BagTick:
    tick = world.tick
    curvttc = distance = np.full(len(tick.state), np.nan)
    if safety is not None:
        curvttc, distance, _ = layout.safety_state(safety, len(tick.state), f"{folder}: {SAFETY}")
    return BagTick(
        number=tick.number, period=world.period, state=tick.state, curvttc=curvttc, distance=distance, time=time
    )
