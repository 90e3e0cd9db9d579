"""The drivers, which compute controls from records: a file and a row of `TABLE` each.

`replay` has no row: its two functions move the agents themselves. `walker` is the pedestrian of "autopilot". Without a
command or an action the rule-based pair drives.

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

from dataclasses import dataclass

from vpsci_ros.safety.compiled import Kernel
from vpsci_ros.world.compiled import choice, inlined
from vpsci_ros.world.drivers import autopilot, constant_velocity, external, policy, social_force, walker
from vpsci_ros.world.lane_driving import pursuit_curvature
from vpsci_ros.world.spawns import as_recorded
from vpsci_ros.world.spawns.approach import lane_sway, step_towards


@dataclass(frozen=True)
class Driver:
    """A driver: kernels that say how an agent moves in the next tick, by the `Tables`, `Settings` and `Inputs` of it.

    :ivar name: a value of `WorldConfig.vehicle_driver`, `.pedestrian_driver` or both.
    :ivar vehicle: (state, i, count, keeping, answers, tables, settings): returns (steer, throttle, brake) of the
        vehicle in the `count` rows of EPISODE[B] from `i` on; the curvature `keeping` [1/m] keeps the lane.
    :ivar pedestrian: (episode, i, answers, tables, settings): returns the acceleration (ax, ay) [m/s2], map frame, of
        the pedestrian in row `i`, and whether a recorded walker's limit of jerk applies.
    """

    name: str
    vehicle: Kernel | None = None
    pedestrian: Kernel | None = None


TABLE = (
    Driver("policy", policy.vehicle, policy.pedestrian),
    Driver("autopilot", autopilot.vehicle, walker.pedestrian),
    Driver("external", external.vehicle, external.pedestrian),
    Driver("constant_velocity", pedestrian=constant_velocity.pedestrian),
    Driver("social_force", pedestrian=social_force.pedestrian),
)
REPLAY = -1  # no row
VEHICLE_DRIVERS = {row.name: index for index, row in enumerate(TABLE) if row.vehicle} | {"replay": REPLAY}
PEDESTRIAN_DRIVERS = {row.name: index for index, row in enumerate(TABLE) if row.pedestrian} | {"replay": REPLAY}
POLICY, AUTOPILOT, EXTERNAL = (VEHICLE_DRIVERS[name] for name in ("policy", "autopilot", "external"))
_VEHICLE = choice({index: row.vehicle for index, row in enumerate(TABLE) if row.vehicle})
_PEDESTRIAN = choice({index: row.pedestrian for index, row in enumerate(TABLE) if row.pedestrian})


@inlined
def controls(state, i, count, answers, tables, settings):  # type: ignore[no-untyped-def]
    """Return (steer, throttle, brake) for the next tick, by the driver of the vehicle in `count` rows from `i` on."""
    episode, driver = state[i], settings.vehicle_driver
    row = tables.rows[episode.table]
    lane, place = (tables.lane, episode.table, row.lane_count, row.lane_step), (episode.vehicle_x, episode.vehicle_y)
    aside = lane_sway(episode) if as_recorded(settings.spawn, episode) else 0.0
    keeping = pursuit_curvature(*lane, episode.route_s, aside, *place, episode.vehicle_heading, episode.vehicle_speed)
    told = len(answers.vehicle_control) or len(answers.vehicle_action)
    if (driver == POLICY and not episode.vehicle_held) or (driver == EXTERNAL and not told):
        driver = AUTOPILOT
    return _VEHICLE(driver, state, i, count, keeping, answers, tables, settings)


@inlined
def acceleration(episode, i, answers, tables, settings, pushes):  # type: ignore[no-untyped-def]
    """Return the pedestrian's acceleration (ax, ay) [m/s2] in the map frame, after the gain of (21)-(24).

    The repulsion by the episode's other pedestrians, `pushes` float64[B, 2] [m/s2], is added with every driver.
    """
    driver, told = settings.pedestrian_driver, len(answers.pedestrian_action)
    if (driver == POLICY and not episode.pedestrian_held) or (driver == EXTERNAL and not told):
        driver = AUTOPILOT
    ax, ay, smooth = _PEDESTRIAN(driver, episode, i, answers, tables, settings)
    if episode.pedestrians > 1:
        ax, ay = ax + pushes[i, 0], ay + pushes[i, 1]
    if smooth:
        ax, ay = step_towards(episode, ax, ay, settings.period)
    return ax, ay
