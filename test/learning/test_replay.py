import numpy as np
import pytest

from vpsci_ros.data.interactions import from_table
from vpsci_ros.learning.replay import WINDOW, History, ReplayBuffer, draw_recorded, recorded_histories, recorded_steps
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.road import LANE_POINTS


def made(steps, real=False, mark=0.0):
    def filled(rows, width):
        return {agent: np.full((rows, width), mark, np.float32) for agent in AGENTS}

    return History(
        filled(steps + 1, 6),
        np.ones(steps + 1, np.float32),
        filled(steps, 2),
        filled(steps, 2),
        filled(steps, 2),
        filled(steps, 2),
        terminal=True,
        real=real,
        lane=np.zeros((steps, 2 * LANE_POINTS), np.float32),
        way=np.zeros((steps, 2), np.float32),
        wanted=np.zeros(2, np.float32),
        rules=np.zeros(4, np.float32),
    )


def test_steps_are_drawn_with_the_probabilities_of_equation_17():
    """Two real steps without error, three simulated of |delta| = 4: P(real) = 0.4 / (0.4 + 3 * 2) at alpha 0.5."""
    real, simulated = made(2, real=True), made(3)
    real.priority, simulated.priority = np.zeros(2), np.full(3, 4.0)
    buffer = ReplayBuffer(100, [real], exponent=0.5, real_bonus=0.2)
    buffer.append(simulated)
    rng = np.random.default_rng(0)
    first = [buffer.draw(1, rng)[0].real for _ in range(4000)]
    assert np.mean(first) == pytest.approx(0.4 / 6.4, abs=0.012)


def test_old_simulated_histories_make_room_and_real_ones_stay():
    buffer = ReplayBuffer(30, [made(10, real=True, mark=-1.0)], 0.6, 0.2)
    for mark in range(5):
        buffer.append(made(8, mark=float(mark)))
    kept = [float(h.observation["vehicle"][0, 0]) for h in buffer.histories]
    assert kept == [-1.0, 3.0, 4.0]
    assert buffer.steps == 26


def test_new_experience_has_the_highest_priority_so_far():
    buffer = ReplayBuffer(100, [made(3, real=True)], 0.6, 0.2)
    buffer.reprioritise(buffer.histories, np.array([[0.5, 7.0, 0.1]]))
    buffer.append(made(2))
    assert buffer.histories[1].priority.tolist() == [7.0, 7.0]
    assert buffer.histories[0].priority.tolist() == [0.5, 7.0, 0.1]


def test_recorded_histories_begin_at_the_onset_with_the_acceleration_of_the_step_before(near_misses):
    """As simulated ones begin at the hand-over: a network cannot tell the two by how much of a past they have."""
    interactions = from_table(near_misses)
    row = int(np.flatnonzero(interactions.first > 0)[0])
    first = int(interactions.first[row])
    before = sum(interactions.length[:row] - 1 > interactions.first[:row])
    history = recorded_histories(interactions)[before]
    for agent in AGENTS:
        assert np.array_equal(history.observation[agent][0], interactions.observation[agent][row, first])
        assert np.array_equal(history.came[agent][0], interactions.action[agent][row, first - 1])
    assert len(history) == interactions.length[row] - 1 - first


def test_recorded_steps_are_drawn_evenly_from_all_and_each_has_its_own_history(near_misses):
    """476 interactions of the right turns hold 13,000 steps; the buffer of 10,000 once left out a fifth of them."""
    interactions = from_table(near_misses)
    batch = draw_recorded(interactions, 4000, np.random.default_rng(0))
    assert batch.present.sum(dim=1).tolist() == [1] * 4000, "one step is learned from in each row"
    drawn = np.unique(batch.observation["vehicle"][np.arange(4000), batch.length - 1].numpy(), axis=0)
    assert len(drawn) > 0.95 * interactions.acted.sum()


def test_a_recorded_step_has_the_last_steps_before_it_and_the_one_after(near_misses):
    interactions = from_table(near_misses)
    row = int(np.argmax(interactions.length))
    at = np.array([3, int(interactions.length[row]) - 2])
    batch = recorded_steps(interactions, np.array([row, row]), at)
    assert batch.length.tolist() == [4, WINDOW]
    assert batch.terminal.tolist() == [False, True]
    for i, begin in enumerate((0, at[1] - WINDOW + 1)):
        n = int(batch.length[i])
        for agent in AGENTS:
            known = interactions.observation[agent][row, begin : begin + n + 1]
            assert np.array_equal(batch.observation[agent][i, : n + 1], known)
            assert np.array_equal(batch.action[agent][i, :n], interactions.action[agent][row, begin : begin + n])
