"""Who drives: taken at critical policy frames, kept while the hold lasts, given back without a jolt."""

import dataclasses

import numpy as np
import pytest
from world.helpers import AUTOPILOT, SCENARIOS, alarm, calm, frames, nothing, run

from vpsci_ros.world import ENDED, EPISODE, RUNNING, World, WorldConfig, handover
from vpsci_ros.world.counter_rng import normals
from vpsci_ros.world.kinematics import MAX_ACCELERATION, MAX_DECELERATION
from vpsci_ros.world.state import HANDED_BACK, HANDED_OVER

CONFIG = WorldConfig()


def records(**fields):
    state = np.zeros(len(next(iter(fields.values()))), EPISODE)
    state["status"] = RUNNING
    for name, values in fields.items():
        state[name] = values
    return state


def test_policies_act_at_every_second_tick_of_a_running_episode():
    state = records(frame=[0, 1, 2, 3, 4])
    assert handover.policy_frame(state, CONFIG).tolist() == [True, False, True, False, True]
    state["status"] = ENDED
    assert not handover.policy_frame(state, CONFIG).any()


def test_policies_act_where_it_is_critical_or_they_still_hold():
    state = records(controlled=[0, 0, 1, 1, 1], hold=[0, 9, 0, 3, 0])
    critical = np.array([1, 0, 1, 0, 0], bool)
    policy_frame = np.ones(5, bool)
    assert handover.acting(state, policy_frame, critical).tolist() == [True, False, True, True, False]
    assert not handover.acting(state, ~policy_frame, critical).any()


def drive_alone(alarms: list[bool], config: WorldConfig = CONFIG):
    """One episode under made-up alarms; return (controlled, step, kinds of event) of each tick."""
    world = World(config, SCENARIOS[:1], [(1, 0)], 1, 1)
    rows = []
    for critical in alarms:
        controlled, step = int(world.state["controlled"][0]), int(world.state["step"][0])
        events = world.advance(alarm(world) if critical else calm(world), nothing(world))
        rows.append((controlled, step, set(events["kind"].tolist())))
    return rows


def test_a_critical_tick_between_policy_frames_waits_for_the_next_one():
    rows = drive_alone([False, True, True, True])
    assert [HANDED_OVER in kinds for *_, kinds in rows] == [False, False, True, False]


def test_control_is_kept_for_the_release_time_and_given_back_at_a_policy_frame():
    rows = drive_alone([True, *[False] * 70], WorldConfig(release_time=3.0))
    given_back = [tick for tick, (*_, kinds) in enumerate(rows) if HANDED_BACK in kinds]
    assert given_back == [62]  # 3 s is 60 ticks: the hold of tick 0 runs out after tick 60, the next frame is 62
    assert [controlled for controlled, *_ in rows[1:63]] == [1] * 62
    assert rows[63][0] == 0


def test_a_flicker_of_the_alarm_does_not_move_control():
    rows = drive_alone([True] + [False, False, False, False, False, True] * 5)
    assert sum(HANDED_OVER in kinds for *_, kinds in rows) == 1
    assert not any(HANDED_BACK in kinds for *_, kinds in rows)


def test_steps_count_the_policies_answers_since_the_hand_over():
    rows = drive_alone([False] * 4 + [True] * 6)
    assert [step for _, step, _ in rows] == [0, 0, 0, 0, 0, 1, 1, 2, 2, 3]


def test_without_a_release_time_control_ends_with_the_danger():
    rows = drive_alone([True, True, False, False], WorldConfig(release_time=0.0))
    assert HANDED_BACK in rows[2][2]


def test_no_policy_driver_means_no_hand_over():
    rows = drive_alone([True] * 6, WorldConfig(vehicle_driver="autopilot", pedestrian_driver="social_force"))
    assert not any(kinds & {HANDED_OVER, HANDED_BACK} for *_, kinds in rows)


@pytest.mark.parametrize("event", [HANDED_OVER, HANDED_BACK])
def test_a_hand_over_creates_no_energy(event):
    """Speeds do not jump: the next tick differs by an acceleration that the vehicle, or legs, can have."""
    world = World(CONFIG, SCENARIOS, [(s, e) for e in range(4) for s in range(1, 9)], 32, 5)
    seen = 0
    before, slots = None, []
    for state, events in frames(world):
        for slot in slots:
            was, now = before[slot], state[slot]
            change = (now["vehicle_speed"] - was["vehicle_speed"]) / CONFIG.tick
            assert -MAX_DECELERATION - 1e-9 <= change <= MAX_ACCELERATION + 1e-9
            assert (
                now["vehicle_speed"] <= was["vehicle_speed"] + 4.5 * CONFIG.tick + 1e-9
            )  # what recorded drivers reach
            jolt = np.hypot(now["pedestrian_vx"] - was["pedestrian_vx"], now["pedestrian_vy"] - was["pedestrian_vy"])
            assert jolt <= 2.5 * CONFIG.tick + 1e-9
            seen += 1
        before, slots = state, events["slot"][events["kind"] == event]
        slots = [s for s in slots if world.state["status"][s] == RUNNING]
    assert seen >= 8


def swerving(state):
    """Actions float64[B, 2] of a nervous policy: braking, with noise of 1.5 m/s2 that depends on episode and step."""
    keys = (state[name].astype(np.int64) for name in ("scenario", "episode", "step"))
    noise = normals(9, *keys, 4)
    return np.stack([1.5 * noise[:, 0] - 0.8, 1.5 * noise[:, 1]], axis=1), 2.0 * noise[:, 2:]


def test_after_a_hand_back_the_vehicle_finds_its_lane_again():
    pairs = [(scenario, number) for number in range(6) for scenario in range(1, 9)]
    off, back = 0.0, []
    config = dataclasses.replace(CONFIG, release_time=3.0)  # early enough for 10 m to be left after it
    for (number, _), rows in run(pairs, batch=48, config=config, policy=swerving).items():
        path = SCENARIOS[number - 1].vehicle.path
        left = np.array([abs(path.locate(r["vehicle_x"], r["vehicle_y"])[1]) for r in rows])
        held = np.flatnonzero(rows["controlled"])
        if len(held):
            off = max(off, left[held].max())
            driven = rows["vehicle_path"] - rows["vehicle_path"][held[-1]]
            back += left[held[-1] :][driven[held[-1] :] > 10.0].tolist()
    assert off > 0.5  # the policy took it well off the centre of its lane
    assert len(back) > 100
    assert max(back) < 0.3


def test_an_episode_that_is_never_critical_is_the_autopilots_alone():
    episodes, paper = [(2, e) for e in range(24)], {"spawn": "paper"}
    with_policy = run(episodes, config=dataclasses.replace(CONFIG, **paper))
    alone = run(episodes, config=dataclasses.replace(AUTOPILOT, **paper))
    calm = [key for key, rows in with_policy.items() if not rows["controlled"].any()]
    assert calm
    for key in calm:
        assert with_policy[key].tobytes() == alone[key].tobytes()
