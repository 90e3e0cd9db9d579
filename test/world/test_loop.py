"""The loop: one tick after the other, its values made once, the same whoever drives it."""

import numpy as np
import pytest
from world.helpers import AUTOPILOT, SCENARIOS, calm

from vpsci_ros.world import RUNNING, World, WorldConfig, handover
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.monitor import MonitorConfig, assess
from vpsci_ros.world.tick import NO_ACTIONS, Actions

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
        curvttc, distance, critical = assess(tick.state, MonitorConfig())
        frame = handover.policy_frame(tick.state, WorldConfig())
        assert assessment.curvttc.tobytes() == curvttc.tobytes()
        assert assessment.distance.tobytes() == distance.tobytes()
        assert tick.policy_frame.tolist() == frame.tolist()
        assert assessment.acting.tolist() == handover.acting(tick.state, frame, critical).tolist()
        assert (actions.vehicle is not None) == frame.any()
        acted += int(assessment.acting.sum())
    assert acted > 50


def test_agents_act_once_at_policy_frames_only():
    agent = Braking()
    numbers = [
        step.tick.number for step in Loop(World(WorldConfig(), SCENARIOS, PAIRS, 6, 1), agents={"vehicle": agent})
    ]
    ticks = [number for number, *_ in agent.ticks]
    assert numbers == list(range(len(numbers)))
    assert ticks == sorted(set(ticks))
    assert all(number % 2 == 0 for number in ticks)


def test_a_step_keeps_its_tick_when_the_world_has_moved_on():
    loop = Loop(World(AUTOPILOT, SCENARIOS, PAIRS, 4, 1))
    first = loop.step()
    before = first.tick.state.tobytes()
    loop.step()
    assert first.tick.state.tobytes() == before
    assert (first.tick.state["frame"] == 0).all()


def test_a_tick_is_assessed_once_and_again_after_episodes_were_placed(monkeypatch):
    calls = []
    monkeypatch.setattr("vpsci_ros.world.loop.assess", lambda *given: calls.append(1) or assess(*given))
    world = World(AUTOPILOT, SCENARIOS, [], 2, 1)
    loop = Loop(world)
    world.place([0, 1], [(1, 0), (2, 0)])
    assert loop.assessment is loop.assessment
    before = loop.assessment.distance
    world.place([1], [(5, 3)])
    assert (loop.assessment.distance != before).tolist() == [False, True]
    loop.step()
    assert len(calls) == 2


def test_where_every_episode_counts_as_critical_policies_act_from_the_first_frame():
    loop = Loop(World(WorldConfig(), SCENARIOS, PAIRS, 4, 1), always_critical=True)
    assert loop.assessment.acting.all()
    loop.step(Actions(np.zeros((4, 2)), np.zeros((4, 2))))
    assert loop.world.state["controlled"].all()


def test_a_tick_without_an_answer_of_the_monitor_keeps_who_still_holds_control():
    world = World(WorldConfig(), SCENARIOS, [(1, 0), (2, 0)], 2, 1)
    world.state["controlled"], world.state["hold"] = [1, 0], [9, 9]
    unassessed = world.now.unassessed()
    assert unassessed.acting.tolist() == [True, False]
    assert not unassessed.answered
    assert not unassessed.critical.any()
    assert np.isinf(unassessed.curvttc).all()


@pytest.mark.parametrize("ticks", [1, 2, 5])
def test_a_restart_begins_the_queue_again_at_the_next_policy_tick(ticks):
    def fresh(first_tick=0):
        return World(AUTOPILOT, SCENARIOS, PAIRS, 4, 1, first_tick=first_tick)

    loop = Loop(fresh())
    for _ in range(ticks):
        loop.step()
    loop.restart(fresh)
    number = loop.world.now.number
    assert ticks < number <= ticks + 2
    assert number % 2 == 0
    assert loop.world.now.policy_frame.all()
    assert loop.world.state.tobytes() == fresh().state.tobytes()
    assert (loop.step().tick.state["status"] == RUNNING).all()


def test_an_action_is_float64_whatever_its_agent_computes_in():
    actions = Actions(vehicle=np.float32([[0.1, 0.2]]))
    assert actions.of("vehicle").dtype == np.float64
    assert actions.of("pedestrian") is None
    world = World(WorldConfig(), SCENARIOS, [(1, 0)], 1, 1)
    assert world.advance(calm(world), NO_ACTIONS)["kind"].tolist() == []


def test_nobody_acts_in_a_world_without_policies_however_critical():
    loop = Loop(World(AUTOPILOT, SCENARIOS, PAIRS, 4, 1), always_critical=True)
    assert loop.world.now.policy_frame.all()
    assert not loop.assessment.acting.any()
