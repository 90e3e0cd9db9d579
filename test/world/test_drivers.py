"""Whoever drives: an external system, a recording, constant velocity, social forces."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from world.helpers import AUTOPILOT, SCENARIOS, alarm, calm, episodes, run

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import COLLISION, RUNNING, Recorded, World, WorldConfig
from vpsci_ros.world.kinematics import MAX_DECELERATION
from vpsci_ros.world.state import VEHICLE_ACTION_MISSING
from vpsci_ros.world.tick import Actions

EXTERNAL = WorldConfig(vehicle_driver="external", pedestrian_driver="autopilot")


def world_of(config, scenario=1, episode=0, recorded=None):
    return World(config, SCENARIOS, [(scenario, episode)], 1, 1, recorded)


def test_an_external_system_has_full_control_at_every_tick_critical_or_not():
    for safety in (calm, alarm):
        world = world_of(EXTERNAL)
        for steer in (0.5, -0.25, 1.0):
            world.advance(safety(world), Actions(vehicle_control=np.array([[steer, 0.3, 0.0]])))
            assert world.state["steer"][0] == steer
            assert world.state["throttle"][0] == 0.3
        assert world.state["vehicle_acceleration"][0] == pytest.approx(0.3 * 9.25)


def test_controls_beyond_their_range_are_clipped():
    world = world_of(EXTERNAL)
    world.advance(calm(world), Actions(vehicle_control=np.array([[-3.0, -1.0, 7.0]])))
    assert (world.state["steer"][0], world.state["throttle"][0], world.state["brake"][0]) == (-1.0, 0.0, 1.0)


def test_an_external_acceleration_goes_through_equations_18_to_20_where_lane_following_is_off():
    world = world_of(dataclasses.replace(EXTERNAL, lane_following=False))
    before = world.state.copy()
    world.advance(calm(world), Actions(np.array([[-2.0, 0.0]])))
    assert world.state["vehicle_acceleration"][0] == pytest.approx(-2.0)
    assert world.state["vehicle_heading"] == before["vehicle_heading"]


def test_an_external_acceleration_along_the_vehicle_alone_keeps_it_on_its_lane_through_the_turn():
    world, path = world_of(replace(EXTERNAL, spawn="human"), scenario=1), SCENARIOS[0].vehicle.path
    turned = world.state["vehicle_heading"][0]
    worst = 0.0
    while world.state["status"][0] == RUNNING:
        along = np.clip(4.0 - world.state["vehicle_speed"], -2.0, 2.0)
        world.advance(calm(world), Actions(np.array([[along[0], 0.0]])))
        worst = max(worst, abs(path.locate(world.state["vehicle_x"][0], world.state["vehicle_y"][0])[1]))
    assert turned - world.state["vehicle_heading"][0] > 1.0
    assert worst < 0.5


def test_without_an_external_answer_the_autopilot_drives_for_the_tick_and_an_event_says_so():
    world, alone = world_of(EXTERNAL), world_of(AUTOPILOT)
    for _ in range(20):
        assert VEHICLE_ACTION_MISSING in world.advance(calm(world))["kind"]
        alone.advance(calm(alone))
    assert world.state["vehicle_x"] == alone.state["vehicle_x"]
    assert world.state["vehicle_y"] == alone.state["vehicle_y"]


def test_an_external_pedestrian_moves_by_equations_21_to_24():
    world = world_of(WorldConfig(vehicle_driver="autopilot", pedestrian_driver="external"), scenario=4)
    before = world.state.copy()
    world.advance(calm(world), Actions(pedestrian=np.array([[3.0, 0.0]])))
    h = before["vehicle_heading"][0]
    change = [world.state[n][0] - before[n][0] for n in ("pedestrian_vx", "pedestrian_vy")]
    assert change == pytest.approx(0.5 * 3.0 * 0.05 * np.array([np.cos(h), np.sin(h)]))


def test_constant_velocity_is_constant_from_setting_off():
    config = WorldConfig(spawn="paper", vehicle_driver="autopilot", pedestrian_driver="constant_velocity")
    waited = 0
    for rows in run([(s, e) for e in range(3) for s in range(1, 9)], config=config).values():
        walking = rows["frame"] * config.tick >= rows["start_delay"] + config.tick
        waited += not walking.all()
        velocity = np.stack([rows["pedestrian_vx"], rows["pedestrian_vy"]], axis=1)
        assert len(np.unique(velocity[walking], axis=0)) <= 1
        assert np.hypot(*velocity[walking].T) == pytest.approx(rows["walking_speed"][walking])
        assert not velocity[rows["frame"] * config.tick < rows["start_delay"]].any()
    assert waited >= 3


def test_a_social_force_walker_collides_less_than_one_that_ignores_the_vehicle():
    pairs = [(s, e) for e in range(40) for s in (1, 3, 5, 7)]
    collisions = {}
    for driver in ("autopilot", "social_force"):
        found = run(pairs, batch=64, config=WorldConfig(vehicle_driver="autopilot", pedestrian_driver=driver))
        collisions[driver] = sum(rows["outcome"][-1] == COLLISION for rows in found.values())
    assert collisions["social_force"] < 0.5 * collisions["autopilot"]


def test_a_social_force_walker_stops_one_metre_short_of_a_vehicle_standing_in_its_way():
    slow = dataclasses.replace(SCENARIOS[6].pedestrian, speed=(1.4, 1.4), offset=(0.0, 0.0), arrival=(4.0, 4.0))
    scenario = dataclasses.replace(SCENARIOS[6], pedestrian=slow)
    config = WorldConfig(spawn="paper", vehicle_driver="external", pedestrian_driver="social_force")
    world = World(config, [scenario], [(7, 0)], 1, 1)
    crossing = scenario.pedestrian.path.at(scenario.pedestrian.conflict)
    world.state["vehicle_x"], world.state["vehicle_y"] = crossing
    world.state["vehicle_heading"], world.state["vehicle_speed"] = np.pi / 2, 0.0
    while world.state["frame"][0] < 199:
        world.advance(calm(world), Actions(vehicle_control=np.zeros((1, 3))))
    side = abs(world.state["pedestrian_x"][0] - crossing[0]) - 1.85 / 2 - 0.3
    assert side == pytest.approx(1.0, abs=0.02)
    assert np.hypot(world.state["pedestrian_vx"][0], world.state["pedestrian_vy"][0]) < 0.02


def recorded_from(rows):
    vehicle = np.stack([rows[f"vehicle_{n}"] for n in ("x", "y", "heading", "speed", "curvature")], axis=1)
    pedestrian = np.stack([rows[f"pedestrian_{n}"] for n in ("x", "y", "vx", "vy")], axis=1)
    return vehicle, pedestrian


@pytest.mark.parametrize("drivers", [("replay", "replay"), ("replay", "autopilot"), ("autopilot", "replay")])
def test_a_replayed_episode_is_the_recorded_one(drivers):
    pairs = [(s, e) for e in range(2) for s in range(1, 9)]
    original = run(pairs)
    recorded = Recorded({key: recorded_from(rows) for key, rows in original.items()})
    config = WorldConfig(vehicle_driver=drivers[0], pedestrian_driver=drivers[1])
    replayed = episodes(World(config, SCENARIOS, pairs, 5, 1, recorded))
    for key, rows in replayed.items():
        assert len(rows) == len(original[key])
        for name in ("vehicle_x", "vehicle_heading", "vehicle_speed", "pedestrian_x", "pedestrian_vy", "outcome"):
            assert np.array_equal(rows[name], original[key][name]), (key, name)


def test_beyond_its_recording_a_vehicle_goes_on_straight_and_a_pedestrian_keeps_its_velocity():
    rows = run([(2, 0)])[2, 0][:40]
    config = WorldConfig(vehicle_driver="replay", pedestrian_driver="replay")
    world = world_of(config, 2, 0, Recorded({(2, 0): recorded_from(rows)}))
    while world.state["frame"][0] < 60 and world.state["status"][0] == RUNNING:
        world.advance(calm(world))
    last = rows[-1]
    assert world.state["vehicle_heading"][0] == last["vehicle_heading"]
    ahead = last["vehicle_speed"] * (int(world.state["frame"][0]) - 39) * 0.05  # the recording ends at frame 39
    assert ahead > 1.0
    assert world.state["vehicle_x"][0] == pytest.approx(last["vehicle_x"] + ahead * np.cos(last["vehicle_heading"]))
    assert world.state["pedestrian_vx"][0] == last["pedestrian_vx"]


@pytest.mark.parametrize(
    ("episodes_given", "message"),
    [
        ({}, "at least one episode"),
        ({(1, 0): (np.zeros((3, 4)), np.zeros((3, 4)))}, r"\[frames, 5\] for the vehicle"),
        ({(1, 0): (np.zeros((3, 5)), np.full((3, 4), np.nan))}, r"\[frames, 4\] for the pedestrian"),
        ({(1, 0): (np.zeros((3, 5)), np.zeros((2, 4)))}, "as many frames for both agents, got 3 and 2"),
        ({(1, 0): (np.full((3, 5), -1.0), np.zeros((3, 4)))}, "speed is negative"),
    ],
)
def test_a_bad_recording_is_refused(episodes_given, message):
    with pytest.raises(InvalidInput, match=message):
        Recorded(episodes_given)


def test_a_replay_driver_needs_its_recording():
    config = WorldConfig(vehicle_driver="replay", pedestrian_driver="replay")
    with pytest.raises(InvalidInput, match="needs recordings"):
        world_of(config)
    with pytest.raises(InvalidInput, match="scenario 1, episode 0: a replay driver needs its recording"):
        world_of(config, recorded=Recorded({(1, 7): (np.zeros((3, 5)), np.zeros((3, 4)))}))


def test_an_external_brake_stops_the_vehicle_as_physics_says():
    world = world_of(EXTERNAL)
    speed = world.state["vehicle_speed"][0]
    for _ in range(40):
        world.advance(calm(world), Actions(vehicle_control=np.array([[0.0, 0.0, 1.0]])))
    assert world.state["vehicle_speed"][0] == 0.0
    assert world.state["vehicle_path"][0] == pytest.approx(speed**2 / (2 * MAX_DECELERATION))
