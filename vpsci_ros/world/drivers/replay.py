"""The replay drivers: an agent follows its recorded positions, and goes straight on after the last one."""

import math

from vpsci_ros.world.compiled import inlined
from vpsci_ros.world.kinematics import move_pedestrian, move_vehicle


@inlined
def vehicle(episode, recordings, period):  # type: ignore[no-untyped-def]
    """Move the vehicle to its next recorded position; after the recording it goes straight on."""
    frame = episode.frame + 1
    if frame >= recordings.frames[episode.recording]:
        move_vehicle(episode, 0.0, 0.0, 0.0, period)
        return
    x, y, heading, speed, curvature = recordings.vehicle[episode.recording, frame]
    episode.vehicle_path += math.sqrt((x - episode.vehicle_x) ** 2 + (y - episode.vehicle_y) ** 2)
    episode.vehicle_acceleration = (speed - episode.vehicle_speed) / period
    episode.vehicle_x, episode.vehicle_y, episode.vehicle_heading = x, y, heading
    episode.vehicle_speed, episode.vehicle_curvature = speed, curvature


@inlined
def pedestrian(episode, recordings, settings):  # type: ignore[no-untyped-def]
    """Move the pedestrian to its next recorded position; after the recording it keeps its velocity."""
    frame = episode.frame + 1
    if frame >= recordings.frames[episode.recording]:
        move_pedestrian(episode, 0.0, 0.0, settings)
        return
    x, y, vx, vy = recordings.pedestrian[episode.recording, frame]
    episode.pedestrian_path += math.sqrt((x - episode.pedestrian_x) ** 2 + (y - episode.pedestrian_y) ** 2)
    episode.pedestrian_x, episode.pedestrian_y, episode.pedestrian_vx, episode.pedestrian_vy = x, y, vx, vy
