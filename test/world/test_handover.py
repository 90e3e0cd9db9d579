"""Who drives: taken at critical policy frames, kept while the hold lasts, given back without a jolt."""

import dataclasses

import numpy as np
from world.helpers import AUTOPILOT, SCENARIOS, alarm, calm, frames, nothing, run

from vpsci_ros.world import RUNNING, World, WorldConfig
from vpsci_ros.world.kinematics import MAX_ACCELERATION, MAX_DECELERATION
from vpsci_ros.world.state import HANDED_BACK, HANDED_OVER

CONFIG = WorldConfig()


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


def test_neither_hand_over_nor_hand_back_creates_energy():
    """Speeds do not jump: the next tick differs by an acceleration that the vehicle, or legs, can have."""
    world = World(CONFIG, SCENARIOS, [(s, e) for e in range(4) for s in range(1, 9)], 32, 5)
    seen = {HANDED_OVER: 0, HANDED_BACK: 0}
    before, moved = None, []
    for state, events in frames(world):
        for slot, kind in moved:
            was, now = before[slot], state[slot]
            change = (now["vehicle_speed"] - was["vehicle_speed"]) / CONFIG.tick
            assert -MAX_DECELERATION - 1e-9 <= change <= MAX_ACCELERATION + 1e-9
            assert (
                now["vehicle_speed"] <= was["vehicle_speed"] + 4.5 * CONFIG.tick + 1e-9
            )  # what recorded drivers reach
            jolt = np.hypot(now["pedestrian_vx"] - was["pedestrian_vx"], now["pedestrian_vy"] - was["pedestrian_vy"])
            assert jolt <= 2.5 * CONFIG.tick + 1e-9
            seen[kind] += 1
        before = state
        moved = [
            (e["slot"], e["kind"]) for e in events if e["kind"] in seen and world.state["status"][e["slot"]] == RUNNING
        ]
    assert min(seen.values()) >= 8


def test_an_episode_that_is_never_critical_is_the_autopilots_alone():
    episodes, paper = [(2, e) for e in range(24)], {"spawn": "paper"}
    with_policy = run(episodes, config=dataclasses.replace(CONFIG, **paper))
    alone = run(episodes, config=dataclasses.replace(AUTOPILOT, **paper))
    calm = [key for key, rows in with_policy.items() if not rows["controlled"].any()]
    assert calm
    for key in calm:
        assert with_policy[key].tobytes() == alone[key].tobytes()
