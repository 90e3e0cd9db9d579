"""Episodes as ASAM OSI ground truth in MCAP, one trace an episode, with the metadata that OSI requires.

One GroundTruth a frame: the vehicle as host, the pedestrians, and the lane with its boundaries where the road is known.
Positions are the centres of the bounding boxes, z up from a flat road.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import google.protobuf
import numpy as np
from mcap.writer import Writer
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_lane_pb2 import Lane, LaneBoundary
from osi3.osi_object_pb2 import MovingObject
from osi3.osi_version_pb2 import InterfaceVersion, current_interface_version
from osi_utilities import MCAPChannel

from vpsci_ros import __version__
from vpsci_ros.data.episode import RECORDED, Episode
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.formats.exporters import Options
from vpsci_ros.extras.formats.movers import Mover, movers
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.world import Scenario
from vpsci_ros.world.kinematics import WHEELBASE

TOPIC = "ground_truth"
HOST = 1  # id of the vehicle; pedestrians are 2, 3, ...
LANE = 100  # id of the lane; its left and right boundaries are 101 and 102
_METADATA = "net.asam.osi.trace"


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Write NAME_gt.mcap for each episode and return their number."""
    count = 0
    for episode in episodes:
        with atomic_write(folder / f"{episode.label}_gt.mcap") as path:
            _write_trace(episode, path)
        count += 1
    return count


def _write_trace(episode: Episode, path: Path) -> None:
    number = osi_version()
    osi = f"{number.version_major}.{number.version_minor}.{number.version_patch}"
    protobuf = google.protobuf.__version__
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(library=f"vpsci_ros {__version__}")
        about = {
            "version": osi,
            "min_osi_version": osi,
            "max_osi_version": osi,
            "min_protobuf_version": protobuf,
            "max_protobuf_version": protobuf,
            "zero_time": "1970-01-01T00:00:00Z",
            "creation_time": "1970-01-01T00:00:00Z",
            "description": f"{episode.label}: a vehicle and a crossing pedestrian, {episode.outcome}",
            "authors": f"vpsci_ros {__version__}",
            "data_sources": "recording" if episode.outcome == RECORDED else "simulation",
        }
        writer.add_metadata(_METADATA, about)
        channel = MCAPChannel(writer)
        versions = {f"{_METADATA}.channel.osi_version": osi, f"{_METADATA}.channel.protobuf_version": protobuf}
        channel.add_channel(TOPIC, GroundTruth, versions)
        for truth in ground_truths(episode):
            if not channel.write_message(truth, TOPIC):  # it logs errors instead of raising them
                raise InvalidInput(f"{path}: a frame of {episode.label} could not be written; see the log above")
        writer.finish()  # type: ignore[no-untyped-call]


def osi_version() -> InterfaceVersion:
    """Return the version of OSI that the installed library writes."""
    return InterfaceVersion.DESCRIPTOR.file.GetOptions().Extensions[current_interface_version]


def ground_truths(episode: Episode) -> Iterator[GroundTruth]:
    """Yield the ground truth of each frame; time 0 is the episode's first frame."""
    static = GroundTruth()
    static.version.CopyFrom(osi_version())
    static.host_vehicle_id.value = HOST
    if episode.scenario is not None:
        _add_lane(static, episode.scenario)
    agents = [(each.size, _columns(each, episode.period)) for each in movers(episode)]
    for frame, time in enumerate(episode.time):
        truth = GroundTruth()
        truth.CopyFrom(static)
        truth.timestamp.seconds, truth.timestamp.nanos = divmod(round(time * 1e9), 1_000_000_000)
        for number, (size, columns) in enumerate(agents, HOST):
            _add_object(truth.moving_object.add(), number, columns[frame], size)
        yield truth


def _columns(each: Mover, period: float) -> list[list[float]]:
    """Return x, y, heading, velocity and acceleration (0 in an episode of one frame) of each frame."""
    heading = np.angle(np.exp(1j * each.heading))  # -pi to pi, as OSI has it
    rates = [np.gradient(v, period) if len(v) > 1 else np.zeros(len(v)) for v in (each.vx, each.vy)]
    rows: list[list[float]] = np.stack([each.x, each.y, heading, each.vx, each.vy, *rates], axis=1).tolist()
    return rows


def _add_object(item: MovingObject, number: int, row: list[float], size: tuple[float, float, float]) -> None:
    item.id.value = number
    base = item.base
    base.position.x, base.position.y, base.orientation.yaw, base.velocity.x, base.velocity.y = row[:5]
    base.acceleration.x, base.acceleration.y = row[5:]
    base.dimension.length, base.dimension.width, base.dimension.height = size
    base.position.z = 0.5 * size[2]
    if number != HOST:
        item.type = MovingObject.TYPE_PEDESTRIAN
        return
    item.type = MovingObject.TYPE_VEHICLE
    item.vehicle_classification.type = MovingObject.VehicleClassification.TYPE_CAR
    item.vehicle_attributes.bbcenter_to_rear.x = -0.5 * WHEELBASE
    item.vehicle_attributes.bbcenter_to_front.x = 0.5 * WHEELBASE
    item.vehicle_attributes.number_wheels = 4


def _add_lane(truth: GroundTruth, scenario: Scenario) -> None:
    """Add the lane of a scenario with a boundary on either side."""
    truth.map_reference = f"{scenario.name}.xodr"
    band = scenario.vehicle.path.band(scenario.vehicle.lane_width)
    half = len(band) // 2
    lane = truth.lane.add()
    lane.id.value = LANE
    lane.classification.type = Lane.Classification.TYPE_DRIVING
    lane.classification.is_host_vehicle_lane = True
    lane.classification.centerline_is_driving_direction = True
    for x, y in scenario.vehicle.path.points.tolist():
        lane.classification.centerline.add(x=x, y=y)
    sides = (
        (band[:half], lane.classification.left_lane_boundary_id),
        (band[: half - 1 : -1], lane.classification.right_lane_boundary_id),
    )
    for number, (points, ids) in enumerate(sides, LANE + 1):
        boundary = truth.lane_boundary.add()
        boundary.id.value = number
        boundary.classification.type = LaneBoundary.Classification.TYPE_NO_LINE
        for x, y in points.tolist():
            boundary.boundary_line.add().position.MergeFrom(type(lane.classification.centerline[0])(x=x, y=y))
        ids.add(value=number)
