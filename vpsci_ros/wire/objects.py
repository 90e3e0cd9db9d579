"""The objects of `vpsci_ros.world.perception` as a serialized `sensor_msgs/PointCloud2`, which existing tools read.

A point has its place [m] (z: 0) and velocity [m/s] in the map, and the number of its track, 4 bytes each.
"""

import struct

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.wire.header import LITTLE_ENDIAN, WireHeader
from vpsci_ros.wire.layout import MAP

POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "vx", "vy")] + [("id", "<u4")])
"""A point of the cloud."""

_UINT32, _FLOAT32 = 6, 7  # of sensor_msgs/PointField
_DENSE = b"\x01"  # every point has numbers
_FRAME = MAP.encode() + b"\0"
_HEAD = struct.Struct(f"<4siII{len(_FRAME)}sII")  # up to the width; numbers follow, at multiples of 4 here
_TAIL = struct.Struct("<?3xIII")  # big-endian, sizes of a point, of the row and of the data


def write_objects(objects: NDArray[np.void], header: WireHeader) -> bytes:
    """Return the serialized cloud of OBJECT[n], seen at the stamp of `header`; its frame is the map."""
    points = np.zeros(len(objects), POINT)
    for name, source in (("x", "x"), ("y", "y"), ("vx", "vx"), ("vy", "vy"), ("id", "track")):
        points[name] = objects[source]
    head = _HEAD.pack(LITTLE_ENDIAN, header.seconds, header.nanoseconds, len(_FRAME), _FRAME, 1, len(points))
    tail = _TAIL.pack(False, POINT.itemsize, points.nbytes, points.nbytes)
    return head + _FIELDS + tail + points.tobytes() + _DENSE


def _fields() -> bytes:
    names = POINT.names or ()
    written = struct.pack("<I", len(names))
    for k, name in enumerate(names):
        text = name.encode() + b"\0"
        kind = _UINT32 if name == "id" else _FLOAT32
        written += struct.pack("<I", len(text)) + text + bytes(-len(text) % 4)
        written += struct.pack("<IB3xI", POINT.itemsize // len(names) * k, kind, 1)
    return written


_FIELDS = _fields()
