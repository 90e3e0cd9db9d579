"""The loop: one tick after the other, its values made once, the same whoever drives it."""

import numpy as np
from world.helpers import AUTOPILOT, SCENARIOS

from vpsci_ros.world import World, WorldConfig, handover
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.monitor import assess

PAIRS = [(scenario, number) for number in range(2) for scenario in range(1, 9)]


class Braking:
    """An agent that brakes, and remembers the ticks at which it acted."""

    def __init__(self):
        self.ticks = []

    def act(self, tick, assessment):
        """See `vpsci_ros.world.loop.Agent.act`."""
        self.ticks.append((tick.number, tick.policy_frame.copy(), assessment))
        return np.tile(np.float32([-1.0, 0.0]), (len(tick.state), 1))


def test_the_values_of_each_tick_are_what_their_functions_say():
    acted = 0
    for step in Loop(World(WorldConfig(), SCENARIOS, PAIRS, 6, 1), agents={"vehicle": Braking()}):
        tick, assessment, actions, _ = step
        curvttc, distance, critical = assess(tick.state)
        frame = handover.policy_frame(tick.state, WorldConfig())
        assert assessment.curvttc.tobytes() == curvttc.tobytes()
        assert assessment.distance.tobytes() == distance.tobytes()
        assert tick.policy_frame.tolist() == frame.tolist()
        assert assessment.acting.tolist() == handover.acting(tick.state, frame, critical).tolist()
        assert (actions.vehicle is not None) == frame.any()
        acted += int(assessment.acting.sum())
    assert acted > 50


def test_a_step_keeps_its_tick_when_the_world_has_moved_on():
    loop = Loop(World(AUTOPILOT, SCENARIOS, PAIRS, 4, 1))
    first = loop.step()
    before = first.tick.state.tobytes()
    loop.step()
    assert first.tick.state.tobytes() == before
    assert (first.tick.state["frame"] == 0).all()
