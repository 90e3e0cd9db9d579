"""Events of episodes as a serialized `vpsci_msgs/EpisodeEvent`, byte by byte as ROS 2 writes them."""

from typing import Any

from numpy.typing import NDArray

from vpsci_ros.wire.header import WireHeader, with_numbers, write_start
from vpsci_ros.wire.layout import event_fields


def write_events(events: NDArray[Any], header: WireHeader, tick: int) -> bytes:
    """Return the serialized EpisodeEvent of EVENT[n] records, n > 0, with this header and tick."""
    data = write_start(header, tick)
    for values in event_fields(events).values():
        data = with_numbers(data, values)
    return data
