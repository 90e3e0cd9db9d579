"""The record of one policy step, which the world publishes and the learner learns from."""

import numpy as np

from vpsci_ros.world.observation import ACTION_SIZE, OBSERVATION_SIZE
from vpsci_ros.world.road import LANE_POINTS

TRANSITION = np.dtype(
    [
        ("number", "u8"),
        ("scenario", "u1"),
        ("episode", "u4"),
        ("step", "u4"),
        ("curvttc", "f4"),
        ("vehicle_observation", "f4", OBSERVATION_SIZE),
        ("pedestrian_observation", "f4", OBSERVATION_SIZE),
        ("vehicle_came", "f4", ACTION_SIZE),
        ("pedestrian_came", "f4", ACTION_SIZE),
        ("lane", "f4", 2 * LANE_POINTS),
        ("way", "f4", 2),
        ("wanted", "f4", 2),
        ("release", "f4"),
        ("pedestrian_gain", "f4"),
        ("keeps_lane", "u1"),
        ("limited", "u1"),
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

With `vehicle_came` and `pedestrian_came` [m/s2] the agents have moved since the policy frame before. `lane`, `way`,
`wanted`, `release`, `pedestrian_gain`, `keeps_lane` and `limited` are those of `road.Road`: a learner can continue the
motion itself.

The `next_` fields are zero except in the last transition of a history: the next transition holds them elsewhere.
"""
