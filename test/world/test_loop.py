"""The loop: one tick after the other, which keeps its values."""

from world.helpers import AUTOPILOT, SCENARIOS

from vpsci_ros.world import World
from vpsci_ros.world.loop import Loop


def test_a_step_keeps_its_tick_when_the_world_has_moved_on():
    loop = Loop(World(AUTOPILOT, SCENARIOS, [(s, 0) for s in range(1, 9)], 4, 1))
    first = loop.step()
    before = first.tick.state.tobytes()
    loop.step()
    assert first.tick.state.tobytes() == before
    assert (first.tick.state["frame"] == 0).all()
