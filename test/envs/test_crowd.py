"""Environments with several pedestrians: whoever is most critical is observed."""

import numpy as np

from vpsci_ros.envs.simulation import Simulation
from vpsci_ros.world import WorldConfig
from vpsci_ros.world.monitor import assess
from vpsci_ros.world.tick import Actions

CROWD = WorldConfig(pedestrians=3)


def test_the_most_critical_of_several_pedestrians_is_observed() -> None:
    simulation = Simulation([1, 6], 4, pedestrian="autopilot", config=CROWD)
    for slot in range(4):
        simulation.seed(slot, slot)
    simulation.start(range(4))
    faced = set()
    for _ in range(40):
        shown = simulation.now()
        curvttc, _, _ = assess(simulation.world.state)
        rows = np.arange(0, 12, 3) + curvttc.reshape(4, 3).argmin(axis=1)
        assert shown.state.tobytes() == simulation.world.state[rows].tobytes()
        assert shown.curvttc.tolist() == curvttc.reshape(4, 3).min(axis=1).tolist()
        faced |= set(shown.state["pedestrian"].tolist())
        simulation.step(Actions(vehicle=np.zeros((4, 2))))
    assert len(faced) > 1
