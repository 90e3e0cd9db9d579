"""The drivers, which compute controls from records: a file for each of `VEHICLE_DRIVERS` and `PEDESTRIAN_DRIVERS`.

A driver has a function `vehicle`, which returns (steer, throttle, brake), or `pedestrian`, which returns an
acceleration (ax, ay) [m/s2] in the map frame, or both; those of `replay` move the agent themselves. `walker` is the
pedestrian of "autopilot". Without a command or an action the rule-based pair drives.

Vehicle and pedestrians decide on the same frame: `controls` and `keep_apart` are called before any of them moves, and
`acceleration` reads the pedestrian's own record only.

In reading order:

* `autopilot`: the rule-based driver: keeps its lane and its speed
* `walker`: the walker: follows its route at its speed and does not react to the vehicle
* `policy`: the policy drivers: an agent moves by its policy's last action, held until the next policy frame
* `external`: the external drivers: vehicle or pedestrian moves by commands from outside the world
* `replay`: the replay drivers: an agent follows its recorded positions, and goes straight on after the last one
* `constant_velocity`: a pedestrian that sets off once, at its walking speed, and keeps its velocity
* `social_force`: the social force model: the driver `social_force`, whom the vehicle repels
"""

from vpsci_ros.world.compiled import inlined
from vpsci_ros.world.drivers import autopilot, constant_velocity, external, policy, social_force, walker
from vpsci_ros.world.lane_driving import pursuit_curvature
from vpsci_ros.world.spawns import as_recorded
from vpsci_ros.world.spawns.approach import lane_sway, step_towards
from vpsci_ros.world.world_config import PEDESTRIAN_DRIVERS, VEHICLE_DRIVERS

POLICY, EXTERNAL, REPLAY = (VEHICLE_DRIVERS.index(name) for name in ("policy", "external", "replay"))
CONSTANT_VELOCITY = PEDESTRIAN_DRIVERS.index("constant_velocity")
SOCIAL_FORCE = PEDESTRIAN_DRIVERS.index("social_force")


@inlined
def controls(state, i, count, answers, tables, settings):  # type: ignore[no-untyped-def]
    """Return (steer, throttle, brake) for the next tick, by the driver of the vehicle in `count` rows from `i` on."""
    episode = state[i]
    if settings.vehicle_driver == EXTERNAL and len(answers.vehicle_control):
        control = answers.vehicle_control
        return control[i, 0], control[i, 1], control[i, 2]
    row = tables.rows[episode.table]
    lane, place = (tables.lane, episode.table, row.lane_count, row.lane_step), (episode.vehicle_x, episode.vehicle_y)
    aside = lane_sway(episode) if as_recorded(settings.spawn, episode) else 0.0
    keeping = pursuit_curvature(*lane, episode.route_s, aside, *place, episode.vehicle_heading, episode.vehicle_speed)
    if settings.vehicle_driver == POLICY and episode.vehicle_held:
        return policy.vehicle(episode, keeping, settings)
    if settings.vehicle_driver == EXTERNAL and len(answers.vehicle_action):
        along, left = answers.vehicle_action[i, 0], answers.vehicle_action[i, 1]
        return external.vehicle(episode, along, left, keeping, settings)
    return autopilot.vehicle(state, i, count, keeping, tables, settings)


@inlined
def acceleration(episode, i, answers, tables, settings, pushes):  # type: ignore[no-untyped-def]
    """Return the pedestrian's acceleration (ax, ay) [m/s2] in the map frame, after the gain of (21)-(24).

    The repulsion by the episode's other pedestrians, `pushes` float64[B, 2] [m/s2], is added with every driver.
    """
    ax, ay, smooth = _intended(episode, i, answers, tables, settings)
    if episode.pedestrians > 1:
        ax, ay = ax + pushes[i, 0], ay + pushes[i, 1]
    if smooth:
        ax, ay = step_towards(episode, ax, ay, settings.period)
    return ax, ay


@inlined
def _intended(episode, i, answers, tables, settings):  # type: ignore[no-untyped-def]
    """Return the acceleration (ax, ay) [m/s2] that the driver intends, and whether the limit of jerk applies."""
    driver = settings.pedestrian_driver
    if driver == EXTERNAL and len(answers.pedestrian_action):
        along, left = answers.pedestrian_action[i, 0], answers.pedestrian_action[i, 1]
        ax, ay = external.pedestrian(episode, along, left, settings)
        return ax, ay, False
    if driver == POLICY and episode.pedestrian_held:
        ax, ay = policy.pedestrian(episode, settings)
        return ax, ay, as_recorded(settings.spawn, episode)
    if driver == CONSTANT_VELOCITY:
        ax, ay = constant_velocity.pedestrian(episode, tables, settings)
        return ax, ay, False
    if driver == SOCIAL_FORCE:
        ax, ay = social_force.pedestrian(episode, tables, settings)
        return ax, ay, False
    return walker.pedestrian(episode, tables, settings)
