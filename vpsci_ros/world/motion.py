"""The motion of vehicle and pedestrian through one tick, by controls and by an acceleration."""

import math

from vpsci_ros.world import kinematics
from vpsci_ros.world.compiled import inlined
from vpsci_ros.world.kinds import TOP_SPEED

RUNNING_SPEED = 5.0  # [m/s] that a pedestrian does not exceed: above the 4 m/s of the paper's fastest walkers


@inlined
def move_vehicle(episode, steer, throttle, brake, period):  # type: ignore[no-untyped-def]
    """Move the vehicle through one tick with these controls, clipped to their limits."""
    steer = min(1.0, max(-1.0, steer))
    throttle, brake = min(1.0, max(0.0, throttle)), min(1.0, max(0.0, brake))
    speed = episode.vehicle_speed
    place = episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading
    x, y, heading, next_speed, distance = kinematics.drive(*place, speed, steer, throttle, brake, period)
    episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading, episode.vehicle_speed = x, y, heading, next_speed
    episode.vehicle_acceleration = (next_speed - speed) / period
    if distance > 0.0:
        episode.vehicle_curvature = kinematics.curvature_of(steer)
    episode.steer, episode.throttle, episode.brake = steer, throttle, brake
    episode.vehicle_path += distance


@inlined
def move_pedestrian(episode, ax, ay, settings):  # type: ignore[no-untyped-def]
    """Move the pedestrian through one tick with an acceleration (ax, ay) [m/s2] in the map frame."""
    now = episode.pedestrian_x, episode.pedestrian_y, episode.pedestrian_vx, episode.pedestrian_vy
    x, y, vx, vy = kinematics.walk(*now, ax, ay, 1.0, min(RUNNING_SPEED, TOP_SPEED[episode.kind]), settings.period)
    episode.pedestrian_path += math.sqrt((x - episode.pedestrian_x) ** 2 + (y - episode.pedestrian_y) ** 2)
    episode.pedestrian_ax = (vx - episode.pedestrian_vx) / settings.period
    episode.pedestrian_ay = (vy - episode.pedestrian_vy) / settings.period
    episode.pedestrian_x, episode.pedestrian_y, episode.pedestrian_vx, episode.pedestrian_vy = x, y, vx, vy
