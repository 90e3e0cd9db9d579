"""OpenSCENARIO and OpenDRIVE, read back with scenariogeneration, this package's map reader, and ASAM's checkers."""

import shutil
import subprocess
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from vpsci_ros.extras.formats.exporters import Options, export
from vpsci_ros.extras.formats.movers import movers, road_of
from vpsci_ros.view.episode_sources import read_episodes
from vpsci_ros.world.kinematics import WHEELBASE
from vpsci_ros.world.opendrive import OpenDriveMap

xosc = pytest.importorskip("scenariogeneration.xosc", reason="pip install 'vpsci_ros[formats]'")
BUNDLES = {".xosc": ("xoscBundle", "qc_openscenario"), ".xodr": ("xodrBundle", "qc_opendrive")}


@pytest.fixture(scope="module")
def written(own_bag, tmp_path_factory):
    """Files of the episodes of a bag, once with a vehicle to drive and once with one that drives as it did."""
    folder = tmp_path_factory.mktemp("openscenario")
    for vehicle in ("controllable", "trajectory"):
        export(own_bag, ["openscenario"], folder / vehicle, Options(vehicle=vehicle))
    return folder


@pytest.fixture(scope="module")
def episodes(own_bag):
    return list(read_episodes(own_bag))


def trajectories(path):
    """Return of each road user with a trajectory its vertices: time, x, y, heading."""
    found = {}
    for group in ET.parse(path).getroot().iter("ManeuverGroup"):
        trajectory = xosc.Trajectory.parse(next(group.iter("Trajectory")))
        line = trajectory.shapes
        places = [(place.x, place.y, place.h) for place in line.positions]
        found[next(group.iter("EntityRef")).get("entityRef")] = np.column_stack([line.time, places])
    return found


def test_trajectories_read_back_are_ours_within_a_centimetre_and_the_vehicles_is_that_of_its_rear_axle(
    written, episodes
):
    for episode in episodes:
        found = trajectories(written / "trajectory/openscenario" / f"{episode.label}.xosc")
        assert set(found) == {"Ego", "Pedestrian1"}
        car, walker = movers(episode)
        ours = np.column_stack([episode.time, walker.x, walker.y, walker.heading])
        assert np.abs(found["Pedestrian1"] - ours).max() < 1e-5
        heading = found["Ego"][:, 3]
        centre = found["Ego"][:, 1:3] + 0.5 * WHEELBASE * np.column_stack([np.cos(heading), np.sin(heading)])
        assert np.abs(centre - np.column_stack([car.x, car.y])).max() < 1e-5


def test_a_controllable_vehicle_begins_as_it_began_has_a_route_and_a_controller_and_no_trajectory(written, episodes):
    for episode in episodes:
        path = written / "controllable/openscenario" / f"{episode.label}.xosc"
        assert set(trajectories(path)) == {"Pedestrian1"}
        (private,) = [each for each in ET.parse(path).getroot().iter("Private") if each.get("entityRef") == "Ego"]
        speed = float(next(private.iter("AbsoluteTargetSpeed")).get("value"))
        assert speed == pytest.approx(episode.speed[0])
        route = [(float(p.get("x")), float(p.get("y"))) for p in next(private.iter("Route")).iter("WorldPosition")]
        assert route[-1] == pytest.approx(road_of(episode).vehicle.path.at(road_of(episode).vehicle.goal), abs=1e-5)
        assert next(private.iter("Controller")).get("name") == "ADS"


def test_the_map_read_back_has_our_lane_its_width_and_our_crosswalk_within_a_centimetre(written, episodes):
    for episode in episodes:
        road = OpenDriveMap(written / "trajectory/openscenario" / f"{road_of(episode).name}.xodr")
        line, width = road.route([("1", -1)], 0.5)
        assert width == road_of(episode).vehicle.lane_width
        lane = road_of(episode).vehicle.path
        assert max(abs(lane.locate(x, y)[1]) for x, y in line) < 0.01
        along = [lane.locate(x, y)[0] for x, y in line]
        assert along[0] < -50.0
        assert along[-1] > lane.length + 50.0
        assert np.abs(road.crosswalk(road.crosswalks()[0]) - road_of(episode).crosswalk).max() < 0.01


@pytest.mark.parametrize("ending", [".xosc", ".xodr"])
def test_asams_checkers_find_no_issue(written, ending, tmp_path):
    bundle, program = BUNDLES[ending]
    if not shutil.which(program):
        pytest.skip(f"{program} is not on the PATH: pip install asam-qc-openscenarioxml asam-qc-opendrive (elsewhere)")
    for path in sorted(written.rglob(f"*{ending}")):
        config, result = tmp_path / "config.xml", tmp_path / "result.xqar"
        config.write_text(
            f'<Config><Param name="InputFile" value="{path}"/><CheckerBundle application="{bundle}">'
            f'<Param name="resultFile" value="{result}"/></CheckerBundle></Config>'
        )
        subprocess.run([program, "-c", config], check=True, capture_output=True, timeout=120)
        checks = list(ET.parse(result).getroot().iter("Checker"))
        assert sum(check.get("status") == "completed" for check in checks) >= 15
        assert not any(check.get("status") == "error" for check in checks)
        assert [issue.attrib for check in checks for issue in check.iter("Issue")] == []
