"""A pedestrian that freezes: once CurvTTC is critical, it stops as fast as it can and stays there."""

import numpy as np

from vpsci_ros.policy.agent_types import AgentType
from vpsci_ros.world.observation import observe

FIRMNESS = 4.0  # [1/s] deceleration divided by velocity


class Freezing:
    """See the module's docstring."""

    def __init__(self, agent, config):
        """`config` has the parameters of the pedestrian's node, including its seed; this agent needs none."""

    def act(self, tick, assessment):
        """Return accelerations [m/s2], float32[B, 2], forward and to the left of the car."""
        _, pedestrian = observe(tick.state)  # float32[B, 6]; its first two columns are the pedestrian's velocity
        wanted = np.clip(-FIRMNESS * pedestrian[:, :2], -5.0, 5.0)
        return np.where(assessment.acting[:, None], wanted, np.float32(0.0))


FREEZING = AgentType(Freezing, agents=("pedestrian",))
