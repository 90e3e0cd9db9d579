"""Environments with several pedestrians: whoever is most critical is observed, and a batch is its single ones."""

import numpy as np

from vpsci_ros.envs.right_turn import RightTurnEnv
from vpsci_ros.envs.simulation import Simulation
from vpsci_ros.envs.vector import RightTurnVectorEnv
from vpsci_ros.world import WorldConfig
from vpsci_ros.world.monitor import assess
from vpsci_ros.world.tick import Actions

CROWD = WorldConfig(pedestrians=3)


def test_a_vector_environment_with_several_pedestrians_is_its_single_ones_to_the_bit() -> None:
    drive = np.array([[0.0, 0.4], [0.1, 0.2]], np.float32)
    both = RightTurnVectorEnv(2, scenarios=[1, 6], config=CROWD)
    seen, _ = both.reset(seed=5)
    singles = [RightTurnEnv(scenarios=[1, 6], config=CROWD) for _ in range(2)]
    for i, env in enumerate(singles):
        assert env.reset(seed=5 + i)[0].tobytes() == seen[i].tobytes()
    compared = 0
    for _ in range(40):
        seen, reward, terminated, _, _ = both.step(drive)
        for i, env in enumerate(singles):
            one = env.step(drive[i])
            if not terminated[i]:
                assert one[0].tobytes() == seen[i].tobytes()
                assert one[1] == reward[i]
                compared += 1
        if terminated.any():
            break
    assert compared > 10


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
