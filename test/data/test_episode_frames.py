"""Frames of many parallel episodes become whole episodes, whatever the batch."""

import numpy as np
import pytest

from vpsci_ros.data.episode import QUANTITIES
from vpsci_ros.data.episode_block import EpisodeFrames
from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.state import COLLISION, GOAL, TIMEOUT

LENGTHS = [12, 5, 9, 7, 30]
OUTCOMES = [TIMEOUT, COLLISION, GOAL, GOAL, COLLISION]


def collect(ticks, batch: int, frames: int = 256) -> dict[int, tuple[int, int, np.ndarray]]:
    """Return episode -> (outcome, frames, float32[frames, 10])."""
    collector = EpisodeFrames(batch, frames)
    out = {}
    for tick in ticks:
        done = collector.add(tick)
        for i, record in enumerate(done.records):
            assert record["scenario"] == 1
            values = done.only(np.arange(len(done)) == i).values
            out[int(record["count"])] = (int(record["outcome"]), int(record["frames"]), values)
    assert collector.unfinished == 0
    return out


def test_every_episode_comes_out_once_with_all_its_frames(simulate) -> None:
    episodes = collect(simulate(LENGTHS, OUTCOMES, 2), 2)
    assert {number: episode[:2] for number, episode in episodes.items()} == {
        number: (OUTCOMES[number], LENGTHS[number]) for number in range(5)
    }
    assert not any(np.isnan(values).any() for _, _, values in episodes.values())


def test_velocity_of_the_vehicle_points_along_its_heading(simulate) -> None:
    (_, _, values) = collect(simulate([10], [GOAL], 1), 1)[0]
    column = {name: values[:, i] for i, name in enumerate(QUANTITIES)}
    assert column["velocity_x_av"] == pytest.approx(5.0 * np.cos(0.5))
    assert column["velocity_y_av"] == pytest.approx(5.0 * np.sin(0.5))
    assert column["position_x_av"] == pytest.approx(np.arange(10) * 0.05 * 5.0 * np.cos(0.5), abs=1e-6)
    assert column["velocity_y_ped"] == pytest.approx(1.5)
    assert np.isinf(column["CurvTTC"]).all()


def test_an_end_that_is_shown_for_several_ticks_counts_once(simulate) -> None:
    collector = EpisodeFrames(1)
    *before, last = simulate([6], [GOAL], 1)
    assert [len(collector.add(tick)) for tick in [*before, last, last, last]] == [0] * 5 + [1, 0, 0]


def test_frames_that_nobody_saw_are_not_a_number(simulate) -> None:
    ticks = list(simulate([8], [GOAL], 1))
    (_, frames, values) = collect(ticks[:3] + ticks[5:], 1)[0]
    assert frames == 8
    np.testing.assert_array_equal(np.isnan(values).all(axis=1), [False] * 3 + [True] * 2 + [False] * 3)


def test_what_a_slot_held_before_never_shows_through(simulate) -> None:
    ticks = list(simulate([20, 8], [GOAL, GOAL], 1))
    (_, _, values) = collect(ticks[:22] + ticks[25:], 1)[1]
    assert np.isnan(values[2:5]).all()


def test_a_broken_off_episode_is_counted_and_not_given_out(simulate) -> None:
    collector = EpisodeFrames(1)
    ticks = list(simulate([8, 4], [GOAL, GOAL], 1))
    done = [collector.add(tick) for tick in ticks[:5] + ticks[8:]]
    assert [block.records["count"].tolist() for block in done if len(block)] == [[1]]
    assert collector.unfinished == 1


def test_another_batch_size_is_refused(simulate) -> None:
    tick = next(simulate([3, 3], [GOAL, GOAL], 2))
    with pytest.raises(InvalidInput, match="expected 3 parallel episodes, got 2 states"):
        EpisodeFrames(3).add(tick)
