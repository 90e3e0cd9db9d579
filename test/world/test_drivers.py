"""Whoever drives: an external system, a recording, constant velocity, social forces."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from world.helpers import SCENARIOS, alarm, calm, episodes, run

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import RUNNING, Recorded, World, WorldConfig
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


@pytest.mark.parametrize(
    ("episodes_given", "message"),
    [
        ({}, "at least one episode"),
        ({(1, 0): (np.zeros((3, 4)), np.zeros((3, 4)))}, r"\[frames, 5\] for the vehicle"),
        ({(1, 0): (np.zeros((3, 5)), np.zeros((2, 4)))}, "as many frames for both agents, got 3 and 2"),
        ({(1, 0): (np.full((3, 5), -1.0), np.zeros((3, 4)))}, "speed is negative"),
    ],
)
def test_a_bad_recording_is_refused(episodes_given, message):
    with pytest.raises(InvalidInput, match=message):
        Recorded(episodes_given)
