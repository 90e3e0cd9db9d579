"""Episodes as CommonRoad scenarios (2020a XML): lane, pedestrians as obstacles, the vehicle's planning problem.

The planning problem is the vehicle's: from where it began, with its speed, to the far side of the crosswalk while the
episode lasts. By choice the vehicle is an obstacle with its own trajectory as well, to be looked at.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from commonroad.common.file_writer import CommonRoadFileWriter, OverwriteExistingFile
from commonroad.common.util import AngleInterval, FileFormat, Interval
from commonroad.geometry.shape import Circle, Rectangle
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.lanelet import Lanelet, LaneletNetwork, LaneletType, LineMarking
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from commonroad.scenario.scenario import Location, Scenario, ScenarioID, Tag
from commonroad.scenario.state import CustomState, ExtendedPMState, InitialState
from commonroad.scenario.trajectory import Trajectory

from vpsci_ros.data.episode import Episode
from vpsci_ros.extras.formats.exporters import Options
from vpsci_ros.extras.formats.movers import Mover, lane_lines, movers, road_of
from vpsci_ros.world import Scenario as Road

PROBLEM, LANELET, VEHICLE, PEDESTRIAN = 1, 100, 10, 11  # ids; further pedestrians are 12, 13, ...
_TURN = np.pi / 4  # [rad] to which the heading at the goal may differ from the lane's


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Write NAME.xml for each episode and return their number."""
    count = 0
    for episode in episodes:
        scenario, problem = documents(episode, options.vehicle == "trajectory")
        writer = CommonRoadFileWriter(
            *(scenario, PlanningProblemSet([problem])),
            author="vpsci_ros",
            affiliation="",
            source=f"simulated: {episode.label}, {episode.outcome}",
            tags={Tag.URBAN, Tag.SIMULATED},
            location=Location(),
            decimal_precision=6,
            file_format=FileFormat.XML,
        )
        writer.write_to_file(str(folder / f"{episode.label}.xml"), OverwriteExistingFile.ALWAYS)
        count += 1
    return count


def documents(episode: Episode, with_vehicle: bool) -> tuple[Scenario, PlanningProblem]:
    """Return an episode as CommonRoad's scenario and planning problem.

    :param with_vehicle: add the vehicle as an obstacle with its trajectory.
    :raises InvalidInput: see `movers` and `road_of`.
    """
    road, (vehicle, *pedestrians) = road_of(episode), movers(episode)
    name = ScenarioID(
        country_id="ZAM",
        map_name=f"VpsciLocation{''.join(c for c in road.location if c.isalnum())}",
        map_id=road.number,
        configuration_id=episode.number + 1,  # from 1 on
        obstacle_behavior="T",
        prediction_id=1,
    )
    scenario = Scenario(dt=episode.period, scenario_id=name)
    scenario.add_objects(_lanelets(road))
    for number, each in enumerate(pedestrians, PEDESTRIAN):
        scenario.add_objects(_obstacle(number, ObstacleType.PEDESTRIAN, Circle(0.5 * each.size[0]), each))
    if with_vehicle:
        scenario.add_objects(_obstacle(VEHICLE, ObstacleType.CAR, Rectangle(*vehicle.size[:2]), vehicle))
    turning = float(np.diff(vehicle.heading[:2]).sum()) / episode.period
    return scenario, _problem(road, vehicle, turning)


def _lanelets(road: Road) -> LaneletNetwork:
    centre, left, right = lane_lines(road)
    lanelet = Lanelet(
        *(left, centre, right, LANELET),
        line_marking_left_vertices=LineMarking.NO_MARKING,
        line_marking_right_vertices=LineMarking.NO_MARKING,
        lanelet_type={LaneletType.URBAN},
    )
    return LaneletNetwork.create_from_lanelet_list([lanelet])


def _obstacle(number: int, kind: ObstacleType, shape: Circle | Rectangle, each: Mover) -> DynamicObstacle:
    places = np.stack([each.x, each.y], axis=1)
    initial = _begin(each)
    states = [
        ExtendedPMState(time_step=step, position=place, orientation=heading, velocity=speed, acceleration=0.0)
        for step, (place, heading, speed) in enumerate(zip(places, each.heading, each.speed, strict=True))
    ]
    prediction = TrajectoryPrediction(Trajectory(1, states[1:]), shape)
    return DynamicObstacle(number, kind, shape, initial, prediction)


def _begin(each: Mover, yaw_rate: float = 0.0) -> InitialState:
    return InitialState(
        time_step=0,
        position=np.array([each.x[0], each.y[0]]),
        orientation=float(each.heading[0]),
        velocity=float(each.speed[0]),
        acceleration=0.0,
        yaw_rate=yaw_rate,
        slip_angle=0.0,
    )


def _problem(road: Road, vehicle: Mover, yaw_rate: float) -> PlanningProblem:
    lane = road.vehicle
    heading = lane.path.heading(lane.goal)
    place = Rectangle(vehicle.size[0], lane.lane_width, np.array(lane.path.at(lane.goal)), heading)
    goal = CustomState(
        time_step=Interval(0, len(vehicle.x) - 1),
        position=place,
        orientation=AngleInterval(heading - _TURN, heading + _TURN),
    )
    return PlanningProblem(PROBLEM, _begin(vehicle, yaw_rate), GoalRegion([goal]))
