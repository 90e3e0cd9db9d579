"""Episodes as CommonRoad scenarios (2020a XML): the lane as lanelets, pedestrians as obstacles, a planner's problem.

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

from vpsci_ros.export.episode import Episode, Motion
from vpsci_ros.export.run import Options
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH

PROBLEM, LANELET, VEHICLE, PEDESTRIAN = 1, 100, 10, 11  # ids; further pedestrians are 12, 13, ...
BEYOND = 40.0  # [m] of straight lane before the centreline and after it
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
            source=f"simulated: {episode.name}, {episode.outcome}",
            tags={Tag.URBAN, Tag.SIMULATED},
            location=Location(),
            decimal_precision=6,
            file_format=FileFormat.XML,
        )
        writer.write_to_file(str(folder / f"{episode.name}.xml"), OverwriteExistingFile.ALWAYS)
        count += 1
    return count


def documents(episode: Episode, with_vehicle: bool) -> tuple[Scenario, PlanningProblem]:
    """Return an episode as CommonRoad's scenario and planning problem."""
    road = episode.road
    name = ScenarioID(
        country_id="ZAM",
        map_name=f"VpsciLocation{''.join(c for c in road.location if c.isalnum())}",
        map_id=road.number,
        configuration_id=episode.number + 1,  # from 1 on
        obstacle_behavior="T",
        prediction_id=1,
    )
    scenario = Scenario(dt=episode.period, scenario_id=name)
    scenario.add_objects(_lanelets(episode))
    for number, each in enumerate(episode.pedestrians, PEDESTRIAN):
        scenario.add_objects(_obstacle(number, ObstacleType.PEDESTRIAN, Circle(PEDESTRIAN_RADIUS), each))
    if with_vehicle:
        box = Rectangle(VEHICLE_LENGTH, VEHICLE_WIDTH)
        scenario.add_objects(_obstacle(VEHICLE, ObstacleType.CAR, box, episode.vehicle))
    return scenario, _problem(episode)


def _lanelets(episode: Episode) -> LaneletNetwork:
    lane, width = episode.road.vehicle.path, episode.road.vehicle.lane_width
    along = np.arange(-BEYOND, lane.length + BEYOND, lane.step)
    centre = np.array([lane.at(s) for s in along])
    left, right = (np.array([lane.beside(s, side * width) for s in along]) for side in (0.5, -0.5))
    lanelet = Lanelet(
        *(left, centre, right, LANELET),
        line_marking_left_vertices=LineMarking.NO_MARKING,
        line_marking_right_vertices=LineMarking.NO_MARKING,
        lanelet_type={LaneletType.URBAN},
    )
    return LaneletNetwork.create_from_lanelet_list([lanelet])


def _obstacle(number: int, kind: ObstacleType, shape: Circle | Rectangle, each: Motion) -> DynamicObstacle:
    places = np.stack([each.x, each.y], axis=1)
    initial = InitialState(
        time_step=0,
        position=places[0],
        orientation=float(each.heading[0]),
        velocity=float(each.speed[0]),
        acceleration=0.0,
        yaw_rate=0.0,
        slip_angle=0.0,
    )
    states = [
        ExtendedPMState(time_step=step, position=place, orientation=heading, velocity=speed, acceleration=0.0)
        for step, (place, heading, speed) in enumerate(zip(places, each.heading, each.speed, strict=True))
    ]
    prediction = TrajectoryPrediction(Trajectory(1, states[1:]), shape)
    return DynamicObstacle(number, kind, shape, initial, prediction)


def _problem(episode: Episode) -> PlanningProblem:
    vehicle, road = episode.vehicle, episode.road.vehicle
    begin = InitialState(
        time_step=0,
        position=np.array([vehicle.x[0], vehicle.y[0]]),
        orientation=float(vehicle.heading[0]),
        velocity=float(vehicle.speed[0]),
        acceleration=0.0,
        yaw_rate=0.0,
        slip_angle=0.0,
    )
    heading = road.path.heading(road.goal)
    place = Rectangle(VEHICLE_LENGTH, road.lane_width, np.array(road.path.at(road.goal)), heading)
    goal = CustomState(
        time_step=Interval(0, len(vehicle.x) - 1),
        position=place,
        orientation=AngleInterval(heading - _TURN, heading + _TURN),
    )
    return PlanningProblem(PROBLEM, begin, GoalRegion([goal]))
