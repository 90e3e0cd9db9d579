"""Motion from accelerations: equations (8), (9) and (18)-(24), and the kinematic bicycle of the Model 3.

Scalar functions, compiled, each for one agent, and two that move the agents of an EPISODE record by them. The world
calls these slot by slot, so that an episode's bits do not depend on its batch. The bicycle's reference point, the one
that moves along the heading without side slip, is the centre of the vehicle's rectangle, as in CurvTTC and as (18) has
it: tan(steering angle) / wheelbase is the curvature of the centre's path, and its lateral acceleration is speed squared
times that.
"""

import math

from vpsci_ros.world.compiled import inlined, kernel
from vpsci_ros.world.kinds import TOP_SPEED

WHEELBASE = 2.875  # [m] L of (18), as are the limits below
MAX_ACCELERATION = 9.25  # [m/s2]
MAX_DECELERATION = 8.88  # [m/s2]
MAX_STEERING_ANGLE = 0.52  # [rad] of the front wheels
SHARPEST_TURN = math.tan(MAX_STEERING_ANGLE) / WHEELBASE  # [1/m]
EPSILON = 1e-6  # [m2/s2] epsilon of (18)
RUNNING_SPEED = 5.0  # [m/s] that a pedestrian does not exceed: above the 4 m/s of the paper's fastest walkers


@kernel
def next_velocity(velocity: float, acceleration: float, period: float) -> float:
    """One component of an agent's velocity [m/s] after `period` [s] (equations 8 and 9)."""
    return velocity + acceleration * period


@kernel
def steer_for(lateral: float, speed: float) -> float:
    """Steer, -1 (right) to 1 (left), for a lateral acceleration [m/s2], positive to the left (equation 18)."""
    angle = math.atan(WHEELBASE * lateral / (speed * speed + EPSILON))
    return min(1.0, max(-1.0, angle / MAX_STEERING_ANGLE))


@kernel
def throttle_for(longitudinal: float) -> float:
    """Throttle, 0 to 1, for an acceleration along the heading [m/s2] (equation 19)."""
    return min(longitudinal / MAX_ACCELERATION, 1.0) if longitudinal >= 0.0 else 0.0


@kernel
def brake_for(longitudinal: float) -> float:
    """Brake, 0 to 1, for an acceleration along the heading [m/s2] (equation 20)."""
    return min(-longitudinal / MAX_DECELERATION, 1.0) if longitudinal < 0.0 else 0.0


@kernel
def curvature_of(steer: float) -> float:
    """Curvature [1/m] of the path that a steer of -1 to 1 gives; positive to the left."""
    return math.tan(steer * MAX_STEERING_ANGLE) / WHEELBASE


@kernel
def steer_to(curvature: float) -> float:
    """Steer, -1 to 1, for a path of `curvature` [1/m], as near as the steering angle allows."""
    return min(1.0, max(-1.0, math.atan(WHEELBASE * curvature) / MAX_STEERING_ANGLE))


@kernel
def drive(
    x: float, y: float, heading: float, speed: float, steer: float, throttle: float, brake: float, period: float
) -> tuple[float, float, float, float, float]:
    """Return (x, y, heading, speed, distance driven) after `period` [s] with constant controls, exactly.

    The acceleration is throttle * 9.25 - brake * 8.88 m/s2 and the path an arc. Brakes hold a vehicle that has come
    to rest, within the period too: it never reverses.
    """
    acceleration = throttle * MAX_ACCELERATION - brake * MAX_DECELERATION
    next_speed = speed + acceleration * period
    if next_speed > 0.0:
        distance = 0.5 * (speed + next_speed) * period
    else:
        distance = 0.0 if speed <= 0.0 else -0.5 * speed * speed / acceleration
        next_speed = 0.0
    half_turn = 0.5 * distance * curvature_of(steer)
    chord = distance if abs(half_turn) < 1e-9 else distance * math.sin(half_turn) / half_turn
    direction = heading + half_turn
    x += chord * math.cos(direction)
    y += chord * math.sin(direction)
    return x, y, heading + 2.0 * half_turn, next_speed, distance


@kernel
def walk(
    x: float, y: float, vx: float, vy: float, ax: float, ay: float, gain: float, top_speed: float, period: float
) -> tuple[float, float, float, float]:
    """Return a pedestrian's (x, y, vx, vy) after `period` [s] with acceleration (ax, ay) (equations 21-24).

    v' = v + gain a dt and p' = p + v' dt, in any one frame; gain is 0.5 in the paper. A velocity above `top_speed`
    [m/s] is shortened to it, or to the speed the pedestrian already had, so that nobody is stopped short.
    """
    limit = max(top_speed, math.sqrt(vx * vx + vy * vy))
    vx += gain * ax * period
    vy += gain * ay * period
    speed = math.sqrt(vx * vx + vy * vy)
    if speed > limit:
        vx *= limit / speed
        vy *= limit / speed
    return x + vx * period, y + vy * period, vx, vy


@inlined
def move_vehicle(episode, steer, throttle, brake, period):  # type: ignore[no-untyped-def]
    """Move the vehicle through one tick with these controls, clipped to their limits."""
    steer = min(1.0, max(-1.0, steer))
    throttle, brake = min(1.0, max(0.0, throttle)), min(1.0, max(0.0, brake))
    speed = episode.vehicle_speed
    place = episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading
    x, y, heading, next_speed, distance = drive(*place, speed, steer, throttle, brake, period)
    episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading, episode.vehicle_speed = x, y, heading, next_speed
    episode.vehicle_acceleration = (next_speed - speed) / period
    if distance > 0.0:
        episode.vehicle_curvature = curvature_of(steer)
    episode.steer, episode.throttle, episode.brake = steer, throttle, brake
    episode.vehicle_path += distance


@inlined
def move_pedestrian(episode, ax, ay, settings):  # type: ignore[no-untyped-def]
    """Move the pedestrian through one tick with an acceleration (ax, ay) [m/s2] in the map frame."""
    now = episode.pedestrian_x, episode.pedestrian_y, episode.pedestrian_vx, episode.pedestrian_vy
    x, y, vx, vy = walk(*now, ax, ay, 1.0, min(RUNNING_SPEED, TOP_SPEED[episode.kind]), settings.period)
    episode.pedestrian_path += math.sqrt((x - episode.pedestrian_x) ** 2 + (y - episode.pedestrian_y) ** 2)
    episode.pedestrian_ax = (vx - episode.pedestrian_vx) / settings.period
    episode.pedestrian_ay = (vy - episode.pedestrian_vy) / settings.period
    episode.pedestrian_x, episode.pedestrian_y, episode.pedestrian_vx, episode.pedestrian_vy = x, y, vx, vy
