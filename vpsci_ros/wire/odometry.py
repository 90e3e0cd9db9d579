"""Motions as serialized `nav_msgs/Odometry` and `tf2_msgs/TFMessage`, byte by byte as ROS 2 writes them."""

import struct
from collections.abc import Mapping

from vpsci_ros.wire.header import (
    LITTLE_ENDIAN,
    WireHeader,
    padded,
    with_header,
    with_text,
)
from vpsci_ros.wire.layout import PlanarMotion

_POSE = struct.Struct("<7d")  # x, y, z [m], and the rotation's x, y, z, w
_TWIST = struct.Struct("<6d")  # velocity [m/s] and turning [rad/s] along and about x, y, z
_UNKNOWN = bytes(8 * 36)  # covariance
_ENCAPSULATION = LITTLE_ENDIAN + b"\0\0"


def write_odometry(motion: PlanarMotion, frame: str, header: WireHeader) -> bytes:
    """Return the serialized Odometry of a motion, with child frame "vehicle/base_link" for the `frame` "vehicle"."""
    start = padded(with_text(with_header(_ENCAPSULATION, header), f"{frame}/base_link"), 8)
    return start + _pose(motion) + _UNKNOWN + _TWIST.pack(motion.speed, 0, 0, 0, 0, motion.yaw_rate) + _UNKNOWN


def write_transforms(movers: Mapping[str, PlanarMotion], header: WireHeader) -> bytes:
    """Return the serialized TFMessage of agents' poses; `movers`: agent, such as "vehicle" -> its motion."""
    data = _ENCAPSULATION + struct.pack("<I", len(movers))
    for frame, motion in movers.items():
        data = padded(with_text(with_header(data, header), f"{frame}/base_link"), 8) + _pose(motion)
    return data


def _pose(motion: PlanarMotion) -> bytes:
    return _POSE.pack(motion.x, motion.y, 0.0, 0.0, 0.0, *motion.quaternion)
