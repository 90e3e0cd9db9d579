"""The batch: episodes enter and leave without disturbing the rest, end as they should, and say what happened."""

import itertools
import math
import os
from dataclasses import replace

import numpy as np
import pytest
from world.helpers import AUTOPILOT, SCENARIOS, alarm, calm, frames, nothing, run

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import build
from vpsci_ros.safety import VEHICLE_LENGTH, VEHICLE_WIDTH, clearance, contact_step
from vpsci_ros.world import COLLISION, ENDED, GOAL, RUNNING, TIMEOUT, World, WorldConfig
from vpsci_ros.world.state import FINISHED, PEDESTRIAN_ACTION_MISSING, SAFETY_MISSING, STARTED, VEHICLE_ACTION_MISSING
from vpsci_ros.world.tick import NO_ACTIONS, Actions

PAIRS = [(scenario, number) for number in range(12) for scenario in range(1, 9)]
FEW = PAIRS[:32]
PLACES = ("vehicle_x", "vehicle_y", "vehicle_heading", "pedestrian_x", "pedestrian_y")


@pytest.fixture(scope="module")
def history():
    """Every state and the events after it, of 32 episodes in 10 slots under a policy."""
    return list(frames(World(WorldConfig(), SCENARIOS, FEW, 10, 1)))


def test_every_episode_starts_and_ends_once(history):
    world = World(WorldConfig(), SCENARIOS, FEW, 10, 1)
    events = np.concatenate([world.take_started(), *(events for _, events in history)])
    for kind in (STARTED, FINISHED):
        rows = events[events["kind"] == kind]
        assert sorted(zip(rows["scenario"].tolist(), rows["episode"].tolist(), strict=True)) == sorted(FEW)


def test_the_last_frame_is_shown_for_exactly_one_tick(history):
    for (before, _), (after, _) in itertools.pairwise(history):
        ended = before["status"] == ENDED
        assert (after["status"][ended] != ENDED).all()
    assert sum((state["status"] == ENDED).sum() for state, _ in history) == len(FEW)


def test_all_three_ends_occur_and_are_what_they_say():
    found = set()
    for key, rows in run(PAIRS, config=WorldConfig()).items():
        last, before = rows[-1], rows[:-1]
        touched = contact_step(*(rows[name] for name in PLACES))
        assert (before["status"] == RUNNING).all(), key
        assert (before["outcome"] == 0).all(), key
        assert (touched <= len(before)) == (last["outcome"] == COLLISION), key
        if last["outcome"] == COLLISION:
            assert touched > len(before) - 1
            assert last["least_curvttc"] == 0.0
        elif last["outcome"] == GOAL:
            assert last["vehicle_goal"] == last["pedestrian_goal"] == 1
            assert not (before["vehicle_goal"] & before["pedestrian_goal"]).any()
        else:
            assert last["outcome"] == TIMEOUT
            assert last["frame"] == WorldConfig().episode_ticks
        assert np.array_equal(rows["frame"], np.arange(len(rows)))
        found.add(int(last["outcome"]))
    assert found == {COLLISION, GOAL, TIMEOUT}


@pytest.mark.parametrize("pedestrians", [1, 3])
def test_a_contact_between_two_ticks_is_a_collision_and_a_near_miss_is_none(pedestrians):
    """A car at 12 m/s is 0.6 m further at each tick; the last pedestrian walks past its corner within one of them."""
    outcomes = []
    for off in (0.25, 0.35):  # [m] from the corner's point at the middle of the tick; the radius is 0.3 m
        config = WorldConfig(pedestrians=pedestrians, vehicle_driver="external", pedestrian_driver="constant_velocity")
        world = World(config, SCENARIOS, [(1, 0)], 1, 1)
        state, rows = world.state, pedestrians
        heading = float(state["vehicle_heading"][0])
        cos, sin = math.cos(heading), math.sin(heading)
        ahead, aside = np.array([cos, sin]), np.array([-sin, cos])
        way = 0.05 * (3.0 * aside - 12.0 * ahead)  # of the pedestrian from the car in one tick
        normal = np.array([way @ aside, -(way @ ahead)]) / np.hypot(*way)
        middle = (0.5 * VEHICLE_LENGTH + off * normal[0]) * ahead + (0.5 * VEHICLE_WIDTH + off * normal[1]) * aside
        place = np.array([state["vehicle_x"][0], state["vehicle_y"][0]]) + middle - 0.5 * way
        state["vehicle_speed"] = 12.0
        state["pedestrian_x"], state["pedestrian_y"] = place[0] + 50.0 * np.arange(rows)[::-1], place[1]
        state["pedestrian_vx"], state["pedestrian_vy"] = 3.0 * aside
        before = state.copy()
        world.advance(calm(world), Actions(vehicle_control=np.zeros((rows, 3))))
        for at in (before, state):
            assert (clearance(*(at[name] for name in PLACES)) > 0.0).all()
        outcomes.append((int(state["outcome"][-1]), state["struck"].tolist(), float(state["least_curvttc"][-1])))
    assert outcomes[0] == (COLLISION, [0] * (pedestrians - 1) + [1], 0.0)
    assert outcomes[1][:2] == (0, [0] * pedestrians)


def test_actions_hold_for_two_ticks_in_the_frame_in_which_they_were_given():
    world = World(WorldConfig(spawn="paper", pedestrian_gain=1.0, lane_following=False), SCENARIOS, [(3, 0)], 1, 1)
    heading = float(world.state["vehicle_heading"][0])
    velocity = np.array([world.state["pedestrian_vx"][0], world.state["pedestrian_vy"][0]])
    action = np.array([[2.0, 1.0]])
    for tick in range(2):
        answer = Actions(action, action) if tick == 0 else NO_ACTIONS  # no policy acts in between
        world.advance(alarm(world), answer)
    c, s = np.cos(heading), np.sin(heading)
    expected = velocity + 0.1 * np.array([2.0 * c - 1.0 * s, 2.0 * s + 1.0 * c])
    assert [world.state["pedestrian_vx"][0], world.state["pedestrian_vy"][0]] == pytest.approx(expected)
    assert world.state["vehicle_acceleration"][0] == pytest.approx(2.0)


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_an_external_pedestrian_executes_the_configured_share_of_its_command(gain: float) -> None:
    config = replace(AUTOPILOT, spawn="paper", pedestrian_driver="external", pedestrian_gain=gain)
    world = World(config, SCENARIOS, [(3, 0)], 1, 1)
    heading = float(world.state["vehicle_heading"][0])
    velocity = np.array([world.state["pedestrian_vx"][0], world.state["pedestrian_vy"][0]])
    world.advance(calm(world), Actions(pedestrian=np.array([[2.0, 1.0]])))
    c, s = np.cos(heading), np.sin(heading)
    expected = velocity + gain * 0.05 * np.array([2.0 * c - 1.0 * s, 2.0 * s + 1.0 * c])
    assert [world.state["pedestrian_vx"][0], world.state["pedestrian_vy"][0]] == pytest.approx(expected)


def test_a_missing_answer_is_reported_and_the_rule_based_driver_acts_until_the_next():
    world = World(WorldConfig(), SCENARIOS, [(3, 0)], 1, 1)
    alone = World(AUTOPILOT, SCENARIOS, [(3, 0)], 1, 1)
    kinds = world.advance(alarm(world))["kind"]
    assert {VEHICLE_ACTION_MISSING, PEDESTRIAN_ACTION_MISSING} <= set(kinds)
    assert not set(world.advance(alarm(world))["kind"]) & {VEHICLE_ACTION_MISSING, PEDESTRIAN_ACTION_MISSING}
    for _ in range(2):
        alone.advance(alarm(alone))
    for name in ("vehicle_x", "vehicle_speed", "pedestrian_x", "pedestrian_vx"):
        assert world.state[name] == alone.state[name]


def test_an_answer_that_is_missing_where_no_policy_acts_is_reported_and_changes_nothing():
    world, answered = (World(WorldConfig(), SCENARIOS, [(3, 0)], 1, 1) for _ in range(2))
    missing = [VEHICLE_ACTION_MISSING, PEDESTRIAN_ACTION_MISSING]
    assert [world.advance(calm(world))["kind"].tolist() for _ in range(3)] == [missing, [], missing]  # at policy frames
    assert not any(len(answered.advance(calm(answered), nothing(answered))) for _ in range(3))
    assert world.state.tobytes() == answered.state.tobytes()


def test_without_curvttc_nothing_is_critical_and_an_event_says_so():
    world = World(WorldConfig(), SCENARIOS, [(3, 0)], 1, 1)
    assert world.advance(world.now.unassessed(), nothing(world))["kind"].tolist() == [SAFETY_MISSING]
    assert world.state["controlled"][0] == 0
    assert world.state["least_curvttc"][0] == np.inf


def test_an_environment_can_place_episodes_itself_and_others_do_not_notice():
    world = World(AUTOPILOT, SCENARIOS, [], 3, 1)
    world.place([0, 1, 2], [(1, 0), (2, 0), (3, 0)])
    assert not world.done
    for _ in range(10):
        world.advance(calm(world))
    events = world.place([1], [(8, 5)], [77])
    assert (events["kind"].item(), events["slot"].item(), events["scenario"].item()) == (STARTED, 1, 8)
    assert world.state["frame"].tolist() == [10, 0, 10]
    expected = World(AUTOPILOT, SCENARIOS, [(8, 5)], 1, 77).state[0]
    assert world.state[1] == expected
    world.advance(calm(world))
    with pytest.raises(InvalidInput, match="episodes start at policy ticks"):
        world.place([0], [(1, 0)])
    world.advance(calm(world))
    for slots in ([0, 0], [3], [-1]):
        with pytest.raises(InvalidInput, match="different slots from 0 to 2"):
            world.place(slots, [(1, 0)] * len(slots))
    while not world.done:
        world.advance(calm(world))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"tick": 0.03}, "a policy's step = 0.1 s must be a whole multiple of tick = 0.03 s, got 3.33333 ticks"),
        ({"episode_time": 0.33}, "episode_time = 0.33 s must be a whole multiple"),
    ],
)
def test_periods_that_do_not_fit_together_are_refused(values, message):
    with pytest.raises(InvalidInput, match=message):
        WorldConfig(**values)


@pytest.mark.parametrize("tick", [0.02, 0.05, 0.1])
def test_policies_act_every_tenth_of_a_second_at_any_tick_and_no_parameter_says_otherwise(tick):
    world, acted = World(WorldConfig(tick=tick), SCENARIOS, [(3, 0)], 1, 1), []
    while len(acted) < 4:
        if world.now.policy_frame[0]:
            acted.append(world.now.number * tick)
        world.advance(calm(world), nothing(world))
    assert np.diff(acted) == pytest.approx([0.1] * 3)
    with pytest.raises(InvalidInput, match="unknown parameter 'policy_period'"):
        build(WorldConfig, {"policy_period": 0.2}, "params/x.yaml")


def test_bad_answers_are_refused_and_name_the_slot():
    world = World(WorldConfig(), SCENARIOS, PAIRS, 3, 1)
    far, nobody = np.full(3, np.inf), np.zeros(3, bool)
    with pytest.raises(InvalidInput, match=r"curvttc: expected shape \(3,\), got \(2,\)"):
        world.now.assessed(far[:2], far, nobody)
    with pytest.raises(InvalidInput, match=r"critical: expected shape \(3,\), got \(2,\)"):
        world.now.assessed(far, far, nobody[:2])
    with pytest.raises(InvalidInput, match="curvttc of slot 1 is not a number"):
        world.now.assessed(np.array([1.0, np.nan, 1.0]), far, nobody)
    with pytest.raises(InvalidInput, match=r"actions.vehicle of slot 2: expected finite numbers"):
        Actions(vehicle=np.array([[0, 0], [0, 0], [0, np.inf]]))
    with pytest.raises(InvalidInput, match=r"actions.vehicle_control: expected shape \(3, 3\), got \(3, 2\)"):
        Actions(vehicle_control=np.zeros((3, 2)))
    with pytest.raises(InvalidInput, match="actions.pedestrian: expected one row for each of 3 slots, got 2"):
        world.advance(calm(world), Actions(pedestrian=np.zeros((2, 2))))
    assert world.now.number == 0


def test_bad_worlds_are_refused():
    for arguments, message in (
        ((AUTOPILOT, SCENARIOS, [(9, 0)], 1, 1), "episode of scenario 9: this world has scenario 1, 2"),
        ((AUTOPILOT, SCENARIOS, [(1, -1)], 1, 1), "number must be from 0 to"),
        ((AUTOPILOT, SCENARIOS, [], 0, 1), "batch must be at least 1"),
        ((AUTOPILOT, SCENARIOS, [], 1, -1), "seed must be from 0"),
        ((AUTOPILOT, [], [], 1, 1), "expected scenarios with different numbers"),
        ((AUTOPILOT, SCENARIOS[:1] * 2, [], 1, 1), "expected scenarios with different numbers"),
    ):
        with pytest.raises(InvalidInput, match=message):
            World(*arguments)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_process_can_go_on_simulating():
    world = World(AUTOPILOT, SCENARIOS, ((1, e) for e in itertools.count()), 4096, 1)
    world.advance(calm(world))
    child = os.fork()
    if child == 0:
        world.advance(calm(world))
        os._exit(0 if world.now.number == 2 else 1)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0
