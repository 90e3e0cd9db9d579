"""Our pedestrian before a public CommonRoad planner in an exported scenario; beside it, one that replays its track.

    pip install -c constraints.txt '.[commonroad]' commonroad-reactive-planner    # an environment without the extra osi
    vpsci export bags/LocationA_PedCross_E-W --to commonroad -o out/export
    python examples/commonroad_crossing.py out/export/commonroad/*.xml

`make setup` puts these packages into .venv/commonroad instead: PYTHONPATH=.venv/commonroad before both commands.
The planner is commonroad-reactive-planner 2025.1 (BSD): every 0.1 s it samples trajectories along the lane, and takes
the cheapest one that does not touch the pedestrian, whom it expects to walk on as now (0.2 s of CPU). It has no brake
for emergencies: where no sample is drivable and free of contact the episode ends.
"""

import logging
import math
import sys

import numpy as np
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from commonroad.scenario.state import InitialState, KSState
from commonroad.scenario.trajectory import Trajectory
from commonroad_clcs.config import CLCSParams
from commonroad_dc.collision.collision_detection.pycrcc_collision_dispatch import create_collision_object
from commonroad_dc.pycrcc import CollisionChecker
from commonroad_rp.reactive_planner import ReactivePlanner
from commonroad_rp.state import ReactivePlannerState
from commonroad_rp.utility.config import ReactivePlannerConfiguration
from commonroad_rp.utility.utils_coordinate_system import CoordinateSystem

from vpsci_ros import Pedestrian, Vehicle, Walker
from vpsci_ros.safety import clearance

PERIOD, SECONDS, CRUISE = 0.1, 6.0, 4.0  # [s], [s], [m/s]


def expected(shape, me, step, horizon):
    """Return a pedestrian who walks on from a time step as CommonRoad's obstacle, for its collision checker."""
    facing, pace = math.atan2(me.vy, me.vx), math.hypot(me.vx, me.vy)
    places = [np.array([me.x + me.vx * PERIOD * k, me.y + me.vy * PERIOD * k]) for k in range(horizon + 2)]
    begins = InitialState(step, places[0], facing, pace, 0.0, 0.0, 0.0)
    later = [KSState(step + k, place, 0.0, pace, facing) for k, place in enumerate(places[1:], 1)]
    walks = TrajectoryPrediction(Trajectory(step + 1, later), shape)
    return create_collision_object(DynamicObstacle(1, ObstacleType.PEDESTRIAN, shape, begins, walks))


def play(path, reacts, seconds=SECONDS):
    """Drive a scenario whose pedestrian reacts, or replays its track.

    :returns: the car's x, y, heading, speed, the pedestrian's x, y, vx, vy, float64[T, 8], and the car's dimensions.
    """
    scenario, problems = CommonRoadFileReader(path).open()
    walker = next(each for each in scenario.dynamic_obstacles if each.obstacle_type == ObstacleType.PEDESTRIAN)
    track = np.array([walker.state_at_time(k).position for k in range(walker.prediction.final_time_step)])
    every = round(PERIOD / scenario.dt)
    track = np.concatenate([track[::every], np.tile(track[-1], (round(seconds / PERIOD), 1))])
    pace = np.diff(track, axis=0) / PERIOD
    pedestrian = Pedestrian(seed=1, goal=tuple(track[-1]))
    config, scenario.dt = ReactivePlannerConfiguration(), PERIOD
    config.debug.logging_level, config.debug.multiproc = logging.ERROR, False
    config.sampling.d_min, config.sampling.d_max = -0.4, 0.4  # it keeps to its lane
    config.update(scenario=scenario, planning_problem=next(iter(problems.planning_problem_dict.values())))
    planner = ReactivePlanner(config)
    lane = scenario.lanelet_network.lanelets[0].center_vertices
    planner.set_reference_path(coordinate_system=CoordinateSystem(lane, clcs_params=CLCSParams()))
    state, size, shape, rows = planner.x_0, config.vehicle, walker.obstacle_shape, []
    me = Walker(*track[0], *pace[0])
    for step in range(round(seconds / PERIOD)):
        centre = ReactivePlannerState.shift_state_to_center(state, size.wb_rear_axle)
        car = Vehicle(*centre.position, centre.orientation, centre.velocity, length=size.length, width=size.width)
        rows.append((*car[:4], *me))
        seen = CollisionChecker()  # the lane's borders are left out: with them a plan takes a minute
        seen.add_collision_object(expected(shape, me, state.time_step, planner.N))
        planner.reset(config, initial_state_cart=state, collision_checker=seen)
        planner.set_desired_velocity(CRUISE, state.velocity)
        plan = planner.plan()
        walk = pedestrian.step(me, {"car": car}, period=PERIOD)
        me = Walker(*walk[:4]) if reacts else Walker(*track[step + 1], *pace[step + 1])
        if plan is None:
            print(f"{path}: no sample is drivable and free of contact at {step * PERIOD:.1f} s")
            break
        state = plan[0].state_list[1]
    return np.array(rows), size


if __name__ == "__main__":
    for path in sys.argv[1:]:
        for reacts, who in ((True, "our pedestrian"), (False, "its recorded track")):
            rows, size = play(path, reacts)
            near = clearance(*rows.T[:3], *rows.T[4:6], length=size.length, width=size.width).min()
            slow, seconds = rows[:, 3].min(), len(rows) * PERIOD
            print(f"{path}, {who}: nearest {near:.1f} m, the car at {slow:.1f} m/s at least, {seconds:.1f} s")
