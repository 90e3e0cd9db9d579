"""OSI traces, read back with ASAM's osi-python and with asam-osi-utilities."""

import numpy as np
import pytest

from vpsci_ros.episodes import read_episodes
from vpsci_ros.extras.formats.movers import movers
from vpsci_ros.extras.formats.run import export

osi_trace = pytest.importorskip("osi3trace.osi_trace", reason="pip install 'vpsci_ros[formats]'")


@pytest.fixture(scope="module")
def traces(own_bag, tmp_path_factory):
    folder = tmp_path_factory.mktemp("osi") / "out"
    assert export(own_bag, ["osi"], folder) == {"osi": 3}
    return folder / "osi"


def messages(path):
    """Return all ground truths of a trace."""
    trace = osi_trace.OSITrace(str(path), "GroundTruth")
    found = list(trace)
    trace.close()
    return found


def test_ground_truth_read_back_has_our_poses_velocities_sizes_and_times(traces, own_bag):
    for episode in read_episodes(own_bag):
        truths = messages(traces / f"{episode.label}_gt.mcap")
        time = [truth.timestamp.seconds + 1e-9 * truth.timestamp.nanos for truth in truths]
        assert time == pytest.approx(episode.time.tolist())
        for number, each in enumerate(movers(episode)):
            base = [truth.moving_object[number].base for truth in truths]
            pose = np.array([(b.position.x, b.position.y, b.velocity.x, b.velocity.y) for b in base])
            assert np.array_equal(pose, np.column_stack([each.x, each.y, each.vx, each.vy]))
            assert np.cos([b.orientation.yaw for b in base]) == pytest.approx(np.cos(each.heading))
        first = truths[0]
        assert first.host_vehicle_id.value == first.moving_object[0].id.value
        assert first.moving_object[0].base.dimension.length == 4.69
        assert (first.moving_object[0].type, first.moving_object[1].type) == (2, 3)  # vehicle, pedestrian


def test_the_lane_lies_between_its_boundaries(traces, own_bag):
    episode = next(read_episodes(own_bag))
    truth = messages(traces / f"{episode.label}_gt.mcap")[0]
    line = truth.lane[0].classification
    boundaries = {each.id.value: each.boundary_line for each in truth.lane_boundary}
    left, right = (boundaries[ids[0].value] for ids in (line.left_lane_boundary_id, line.right_lane_boundary_id))
    assert len(left) == len(right) == len(line.centerline)
    for centre, one, other in zip(line.centerline, left, right, strict=True):
        middle = 0.5 * (one.position.x + other.position.x), 0.5 * (one.position.y + other.position.y)
        assert middle == pytest.approx((centre.x, centre.y), abs=0.01)


def test_the_trace_names_its_versions_as_osi_asks(traces):
    path = next(iter(sorted(traces.glob("*.mcap"))))
    trace = osi_trace.OSITrace(str(path), "GroundTruth")
    (about,) = trace.get_file_metadata()
    trace.close()
    assert about.name == "net.asam.osi.trace"
    assert about.metadata["min_osi_version"] == about.metadata["max_osi_version"] == about.metadata["version"]
    assert {"min_protobuf_version", "zero_time", "creation_time", "description", "authors"} <= set(about.metadata)


def test_a_second_reader_sees_as_many_frames(traces, own_bag):
    osi = pytest.importorskip("osi_utilities", reason="pip install 'vpsci_ros[formats]'")
    episode = next(read_episodes(own_bag))
    place = {"path": traces / f"{episode.label}_gt.mcap", "topic": "ground_truth"}
    with osi.open_channel(osi.ChannelSpecification(**place, message_type=osi.MessageType.GROUND_TRUTH)) as channel:
        assert sum(1 for _ in channel) == len(episode.time)
