"""The record of one policy step, which the world publishes and the learner learns from."""

import numpy as np

from vpsci_ros.world.observation import ACTION_SIZE, OBSERVATION_SIZE

TRANSITION = np.dtype(
    [
        ("number", "u8"),
        ("scenario", "u1"),
        ("episode", "u4"),
        ("step", "u4"),
        ("curvttc", "f4"),
        ("vehicle_observation", "f4", OBSERVATION_SIZE),
        ("pedestrian_observation", "f4", OBSERVATION_SIZE),
        ("vehicle_action", "f4", ACTION_SIZE),
        ("pedestrian_action", "f4", ACTION_SIZE),
        ("acting", "u1"),
        ("next_curvttc", "f4"),
        ("next_vehicle_observation", "f4", OBSERVATION_SIZE),
        ("next_pedestrian_observation", "f4", OBSERVATION_SIZE),
        ("collision", "u1"),
        ("vehicle_goal", "u1"),
        ("pedestrian_goal", "u1"),
        ("last", "u1"),
        ("terminal", "u1"),
        ("vehicle_policy_version", "u4"),
        ("pedestrian_policy_version", "u4"),
    ]
)
"""A transition, with the fields of `vpsci_msgs/Transition`; `number` counts transitions without gaps.

The `next_` fields are zero except in the last transition of a history: the next transition holds them elsewhere.
"""
