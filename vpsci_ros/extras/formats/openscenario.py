"""Episodes as ASAM OpenSCENARIO XML 1.2, each on an OpenDRIVE map; esmini and CARLA's ScenarioRunner play such files.

Pedestrians follow their trajectories by absolute time. The vehicle begins where it began, with its speed and the route
of its lane, and is given to a controller; or it follows its trajectory, too. A vehicle's reference point is the middle
of its rear axle, as the standard has it, while (x, y) of this package is the centre of its rectangle.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scenariogeneration import xosc

from vpsci_ros.data.episode import Episode, Floats
from vpsci_ros.extras.formats.exporters import Options
from vpsci_ros.extras.formats.movers import Mover, movers, road_of
from vpsci_ros.extras.formats.opendrive import write_map
from vpsci_ros.world import Scenario
from vpsci_ros.world.kinematics import MAX_ACCELERATION, MAX_DECELERATION, MAX_STEERING_ANGLE, WHEELBASE

VEHICLE = "Ego"
MINOR = 2  # of the standard's version 1
REAR_AXLE = 0.5 * WHEELBASE  # [m] behind the centre of the rectangle
CONTROLLER = "external_control"  # module by which CARLA's ScenarioRunner leaves a vehicle to somebody else


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Write NAME.xosc for each episode and, unless a map is given, SCENARIO.xodr; return the number of files."""
    maps: set[Path] = set()
    count = 0
    for episode in episodes:
        scenario = road_of(episode)
        road = options.road or f"{scenario.name}.xodr"
        path = folder / road
        if not options.road and path not in maps:
            write_map(scenario, path)
            maps.add(path)
        document(episode, road, options.vehicle).write_xml(str(folder / f"{episode.label}.xosc"))
        count += 1
    return count + len(maps)


def document(episode: Episode, road: str, vehicle: str) -> xosc.Scenario:
    """Return an episode as OpenSCENARIO.

    :param road: name or file of the map.
    :param vehicle: "controllable" or "trajectory".
    """
    entities, init = xosc.Entities(), xosc.Init()
    act = xosc.Act("episode", _at(0.0, "start of the episode"))
    car, *pedestrians = movers(episode)
    for number, each in enumerate(pedestrians, 1):
        name = f"Pedestrian{number}"
        entities.add_scenario_object(name, _pedestrian(each))
        init.add_init_action(name, xosc.TeleportAction(_positions(each)[0]))
        act.add_maneuver_group(_follow(name, each, episode.time))
    entities.add_scenario_object(VEHICLE, _vehicle(car))
    init.add_init_action(VEHICLE, xosc.TeleportAction(_positions(car, REAR_AXLE)[0]))
    speed = xosc.AbsoluteSpeedAction(float(car.speed[0]), _at_once())
    init.add_init_action(VEHICLE, speed)
    if vehicle == "trajectory":
        act.add_maneuver_group(_follow(VEHICLE, car, episode.time, REAR_AXLE))
    else:
        init.add_init_action(VEHICLE, xosc.AssignRouteAction(_route(road_of(episode), car)))
        init.add_init_action(VEHICLE, _controlled())
    story = xosc.Story("recorded")
    story.add_act(act)
    board = xosc.StoryBoard(init, _at(float(episode.time[-1]), "end of the episode", "stop"))
    board.add_story(story)
    return xosc.Scenario(
        f"{episode.label}: a vehicle and a crossing pedestrian, {episode.outcome}",
        "vpsci_ros",
        xosc.ParameterDeclarations(),
        entities,
        board,
        xosc.RoadNetwork(roadfile=road),
        xosc.Catalog(),
        osc_minor_version=MINOR,
    )


def _positions(each: Mover, behind: float = 0.0) -> list[xosc.WorldPosition]:
    """Return where a road user's reference point is at each frame, `behind` [m] its centre."""
    x, y = each.x - behind * np.cos(each.heading), each.y - behind * np.sin(each.heading)
    rows = np.round(np.stack([x, y, each.heading], axis=1), 6).tolist()
    return [xosc.WorldPosition(x=x, y=y, z=0.0, h=h, p=0.0, r=0.0) for x, y, h in rows]


def _follow(name: str, each: Mover, time: Floats, behind: float = 0.0) -> xosc.ManeuverGroup:
    trajectory = xosc.Trajectory(f"trajectory of {name}", closed=False)
    trajectory.add_shape(xosc.Polyline(np.round(time, 6).tolist(), _positions(each, behind)))
    follow = xosc.FollowTrajectoryAction(
        trajectory, xosc.FollowingMode.position, xosc.ReferenceContext.absolute, scale=1.0, offset=0.0
    )
    event = xosc.Event(f"{name} sets off", xosc.Priority.override)
    event.add_action(f"{name} follows its trajectory", follow)
    event.add_trigger(_at(0.0, f"{name} may set off"))
    maneuver = xosc.Maneuver(f"maneuver of {name}")
    maneuver.add_event(event)
    group = xosc.ManeuverGroup(f"maneuvers of {name}")
    group.add_actor(name)
    group.add_maneuver(maneuver)
    return group


def _at(time: float, name: str, kind: str = "start") -> xosc.ValueTrigger:
    condition = xosc.SimulationTimeCondition(round(time, 6), xosc.Rule.greaterOrEqual)
    return xosc.ValueTrigger(name, 0, xosc.ConditionEdge.none, condition, triggeringpoint=kind)


def _at_once() -> xosc.TransitionDynamics:
    return xosc.TransitionDynamics(xosc.DynamicsShapes.step, xosc.DynamicsDimension.time, 0.0)


def _route(road: Scenario, car: Mover) -> xosc.Route:
    """Return the way along the lane from where the vehicle begins to its goal."""
    lane, goal = road.vehicle.path, road.vehicle.goal
    begin, _ = lane.locate(float(car.x[0]), float(car.y[0]))
    route = xosc.Route("right turn")
    for s in np.linspace(begin, max(goal, begin + 1.0), 5):
        x, y = lane.at(s)
        place = xosc.WorldPosition(x=round(x, 6), y=round(y, 6), z=0.0, h=round(lane.heading(s), 6), p=0.0, r=0.0)
        route.add_waypoint(place, xosc.RouteStrategy.shortest)
    return route


def _controlled() -> xosc.ControllerAction:
    properties = xosc.Properties()
    properties.add_property("module", CONTROLLER)
    controller = xosc.Controller("ADS", properties)
    return xosc.ControllerAction(xosc.AssignControllerAction(controller))


def _vehicle(car: Mover) -> xosc.Vehicle:
    length, width, height = car.size
    box = xosc.BoundingBox(width, length, height, REAR_AXLE, 0.0, 0.5 * height)
    wheel = 0.67  # [m]
    track = width - 0.27  # [m]
    front = xosc.Axle(MAX_STEERING_ANGLE, wheel, track, WHEELBASE, 0.5 * wheel)
    rear = xosc.Axle(0.0, wheel, track, 0.0, 0.5 * wheel)
    limits = 60.0, MAX_ACCELERATION, MAX_DECELERATION  # [m/s], [m/s2], [m/s2]
    vehicle = xosc.Vehicle("vehicle.tesla.model3", xosc.VehicleCategory.car, box, front, rear, *limits)
    vehicle.add_property("type", "ego_vehicle")
    return vehicle


def _pedestrian(each: Mover) -> xosc.Pedestrian:
    length, width, height = each.size
    box = xosc.BoundingBox(width, length, height, 0.0, 0.0, 0.5 * height)
    model = "walker.pedestrian.0001"
    pedestrian = xosc.Pedestrian(model, 80.0, xosc.PedestrianCategory.pedestrian, box, model)
    pedestrian.add_property("type", "simulation")
    return pedestrian
