"""The spawn `mixed`: even episodes by the rules of section 3.2, odd ones as recorded right turns by those given."""

from dataclasses import replace

import numpy as np
from world.helpers import run

from vpsci_ros.world import WorldConfig

MIXED = WorldConfig(spawn="mixed", episode_time=10.0)
PAPER = replace(MIXED, spawn="paper", pedestrian_gain=0.5, release_time=0.5, lane_following=False)
PAIRS = [(scenario, number) for number in range(6) for scenario in range(1, 9)]


def test_even_episodes_are_the_papers_to_the_bit_with_its_hand_back_and_motion():
    pairs = [pair for pair in PAIRS if pair[1] % 2 == 0]
    mixed, papers, ours = (run(PAIRS, config=MIXED), run(pairs, config=PAPER), run(pairs, config=MIXED))
    for pair, rows in papers.items():
        assert rows.tobytes() == mixed[pair].tobytes() == ours[pair].tobytes(), pair
    unlike = run(pairs, config=replace(MIXED, spawn="paper"))
    assert any(unlike[pair].tobytes() != papers[pair].tobytes() for pair in pairs), "the rules matter"


def test_odd_episodes_are_recorded_onsets_by_the_given_rules_until_the_nearer_goal_is_reached():
    pairs = [pair for pair in PAIRS if pair[1] % 2]
    mixed, recorded = run(PAIRS, config=MIXED), run(pairs, config=replace(MIXED, spawn="right_turns"))
    same = controlled = 0
    for pair, rows in recorded.items():
        ours = mixed[pair]
        assert ours["driver_onset"].min() > 0
        if ours[0] == rows[0]:  # else its best place is beyond the crossing, where no goal would be ahead of it
            same += 1
            until = int(np.argmax(ours["vehicle_goal"])) or min(len(ours), len(rows))
            assert ours[:until].tobytes() == rows[:until].tobytes(), pair
            controlled += int((ours["controlled"][:until] != 0).sum())
    assert same >= 0.75 * len(pairs)
    assert controlled > 100, "policies act in what is compared"
