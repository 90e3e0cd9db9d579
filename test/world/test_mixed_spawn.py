"""The spawn `mixed`: even episodes as in section 3.2, odd ones as recorded right turns."""

from dataclasses import replace

import numpy as np
from world.helpers import run

from vpsci_ros.world import WorldConfig

MIXED = WorldConfig(spawn="mixed", vehicle_driver="autopilot", pedestrian_driver="autopilot", episode_time=10.0)
PAIRS = [(scenario, number) for number in range(6) for scenario in range(1, 9)]


def test_even_episodes_are_the_papers_to_the_bit():
    pairs = [pair for pair in PAIRS if pair[1] % 2 == 0]
    rules = replace(MIXED, spawn="paper", release_time=0.5, pedestrian_gain=0.5, lane_following=False)
    mixed, papers = run(PAIRS, config=MIXED), run(pairs, config=rules)
    for pair, rows in papers.items():
        assert rows.tobytes() == mixed[pair].tobytes(), pair


def test_odd_episodes_are_recorded_onsets_until_the_nearer_goal_is_reached():
    pairs = [pair for pair in PAIRS if pair[1] % 2]
    mixed, recorded = run(PAIRS, config=MIXED), run(pairs, config=replace(MIXED, spawn="right_turns"))
    same = 0
    for pair, rows in recorded.items():
        ours = mixed[pair]
        assert ours["driver_onset"].min() > 0
        if ours[0] == rows[0]:  # else its best place is beyond the crossing, where no goal would be ahead of it
            same += 1
            until = int(np.argmax(ours["vehicle_goal"])) or min(len(ours), len(rows))
            assert ours[:until].tobytes() == rows[:until].tobytes(), pair
    assert same >= 0.75 * len(pairs)
