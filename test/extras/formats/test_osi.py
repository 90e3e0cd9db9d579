"""OSI traces, read back with ASAM's osi-python and with asam-osi-utilities."""

import numpy as np
import pytest
from mcap.reader import make_reader
from synthetic import synthetic_near_misses

from vpsci_ros.data.near_misses import write_near_misses
from vpsci_ros.extras.formats.exporters import export
from vpsci_ros.extras.formats.movers import movers
from vpsci_ros.view.episode_sources import read_episodes

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


def sources_of(traces):
    """Return what each trace says it was made from."""
    found = []
    for path in traces.glob("*.mcap"):
        with path.open("rb") as file:
            found += [
                record.metadata["data_sources"]
                for record in make_reader(file).iter_metadata()
                if "data_sources" in record.metadata
            ]
    return found


def test_a_trace_says_whether_it_was_recorded_or_simulated(traces, tmp_path):
    write_near_misses(synthetic_near_misses(2).table, tmp_path / "recorded.parquet")
    assert export(tmp_path / "recorded.parquet", ["osi"], tmp_path / "out") == {"osi": 2}
    assert sources_of(traces) == ["simulation"] * 3
    assert sources_of(tmp_path / "out" / "osi") == ["recording"] * 2
