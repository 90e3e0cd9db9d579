"""Recorded people in simulated episodes: where, when, and from which side they come; nobody is far away."""

import math

import numpy as np
import polars as pl
import pytest

from vpsci_ros.bags.episodes import recorded_from_bag
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.recorded_people import FAR, absent_pedestrians, recorded_people, spawns, write_motion
from vpsci_ros.world import WorldConfig, load_scenarios

SCENARIOS = load_scenarios([1, 2])
CONFIG = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="replay")
EPISODES = [(1, 0), (2, 0), (1, 1), (2, 1)]
BEGINS = spawns(CONFIG, SCENARIOS, EPISODES, 3)


def near_miss(side=1.0, pause=0, interaction=0, walking=1.5):
    """A car along x; a pedestrian walks up to its path along `side` * y, pausing for `pause` steps of 0.1 s on it."""
    time = 0.1 * np.arange(40 + pause)
    walked = walking * np.concatenate([time[:20], np.full(pause, time[19]), time[20:40]])
    return pl.DataFrame(
        {
            "interaction": interaction,
            "curvttc": 1.0 + 0.0 * time,
            "veh_x": 4.0 * time - 8.0,
            "veh_y": 0.0 * time,
            "veh_heading": 0.0 * time,
            "ped_x": 3.0 + 0.0 * time,
            "ped_y": side * (walked - walked[18] - 0.5 * walking * 0.1),
            "ped_vx": 0.0 * time,
            "ped_vy": side * np.gradient(walked, 0.1),
        }
    )


def conflict(n):
    walk = SCENARIOS[EPISODES[n][0] - 1].pedestrian
    return walk.path.beside(walk.conflict, float(BEGINS[n]["pedestrian_offset"])), walk.path.heading(walk.conflict)


def arrival(n):
    begin = BEGINS[n]
    walk = SCENARIOS[EPISODES[n][0] - 1].pedestrian
    return float(begin["start_delay"] + (walk.conflict - begin["pedestrian_s"]) / begin["walking_speed"])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_recorded_person_is_at_the_conflict_point_when_the_episodes_own_pedestrian_would_be(side):
    motion = recorded_people(near_miss(side), BEGINS, SCENARIOS, CONFIG, 1)
    assert list(motion) == EPISODES
    for n, rows in enumerate(motion.values()):
        assert rows.shape == (CONFIG.episode_ticks + 1, 4)
        at = arrival(n) / CONFIG.tick
        place = [np.interp(at, np.arange(len(rows)), rows[:, k]) for k in (0, 1)]
        (x, y), heading = conflict(n)
        assert math.dist(place, (x, y)) < 0.02
        k = int(at)
        assert math.atan2(rows[k, 3], rows[k, 2]) == pytest.approx(heading, abs=1e-6)


def test_positions_and_velocities_agree_and_a_pause_is_kept():
    rows = recorded_people(near_miss(pause=12), BEGINS, SCENARIOS, CONFIG, 1)[1, 0]
    speed = np.hypot(rows[:, 2], rows[:, 3])
    moved = np.hypot(*np.diff(rows[:, :2], axis=0).T) / CONFIG.tick
    assert np.abs(moved - 0.5 * (speed[1:] + speed[:-1])).max() < 0.8, "where it starts and stops within a step"
    assert np.median(np.abs(moved - 0.5 * (speed[1:] + speed[:-1]))) < 1e-6
    assert 0.9 < 0.05 * (speed < 0.1).sum() < 1.4


def test_a_person_who_came_from_the_other_side_of_the_vehicle_is_mirrored():
    def sideways(side):
        table = near_miss(side).with_columns((pl.col("ped_x") + 0.3 * pl.col("ped_y").abs()).alias("ped_x"))
        return recorded_people(table, BEGINS, SCENARIOS, CONFIG, 1)

    for one, other in zip(sideways(1.0).values(), sideways(-1.0).values(), strict=True):
        assert np.allclose(one[:, :2], other[:, :2], atol=1e-9)


def test_everybody_takes_part_once_before_anybody_does_twice():
    people = pl.concat([near_miss(interaction=k, walking=1.0 + 0.1 * k) for k in range(4)])
    motion = recorded_people(people, BEGINS, SCENARIOS, CONFIG, 1)
    speeds = sorted(float(np.hypot(rows[0, 2], rows[0, 3])) for rows in motion.values())
    assert speeds == pytest.approx([1.0, 1.1, 1.2, 1.3])


def test_recordings_in_which_nobody_crosses_are_refused():
    beside = near_miss().with_columns((pl.col("ped_y") * 0.0 + 3.0).alias("ped_y"), pl.lit(0.0).alias("ped_vy"))
    with pytest.raises(InvalidInput, match=r"mine\.parquet: no pedestrian crosses the path of its vehicle"):
        recorded_people(beside, BEGINS, SCENARIOS, CONFIG, 1, "mine.parquet")


def test_a_bag_of_motion_replays_it_to_the_bit(tmp_path):
    motion = recorded_people(near_miss(), BEGINS, SCENARIOS, CONFIG, 1)
    write_motion(motion, BEGINS, CONFIG, tmp_path / "bag")
    recorded = recorded_from_bag(tmp_path / "bag")
    for key, rows in motion.items():
        assert recorded.arrays.pedestrian[recorded.row(*key), : len(rows)].tobytes() == rows.tobytes()


def test_nobody_is_far_away_and_stays_there():
    for (_, rows), begin in zip(absent_pedestrians(BEGINS).items(), BEGINS, strict=True):
        assert math.dist(rows[0, :2], (begin["vehicle_x"], begin["vehicle_y"])) == pytest.approx(FAR)
        assert not rows[:, 2:].any()
