import numpy as np
import pytest

from vpsci_ros.learning.replay import History, ReplayBuffer, collate, up_to_capacity
from vpsci_ros.world.observation import AGENTS


def made(steps, real=False, mark=0.0):
    def filled(rows, width):
        return {agent: np.full((rows, width), mark, np.float32) for agent in AGENTS}

    return History(
        filled(steps + 1, 6),
        np.ones(steps + 1, np.float32),
        filled(steps, 2),
        filled(steps, 2),
        filled(steps, 2),
        True,
        real,
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


def test_a_draw_holds_the_steps_requested_in_distinct_histories():
    buffer = ReplayBuffer(1000, [], 0.6, 0.2)
    for _ in range(20):
        buffer.append(made(7))
    drawn = buffer.draw(50, np.random.default_rng(0))
    assert 50 <= sum(map(len, drawn)) < 57
    assert len({id(h) for h in drawn}) == len(drawn)


def test_a_draw_takes_all_there_is_where_that_is_less():
    buffer = ReplayBuffer(1000, [made(4, real=True)], 0.6, 0.2)
    assert len(buffer.draw(256, np.random.default_rng(0))) == 1


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


def test_the_practical_buffer_holds_whole_histories_up_to_its_capacity():
    histories = [made(n) for n in (5, 6, 7, 8)]
    kept = up_to_capacity(histories, 20, np.random.default_rng(0))
    assert 0 < sum(len(histories[i]) for i in kept) <= 20
    assert sorted(up_to_capacity(histories, 1000, np.random.default_rng(0))) == [0, 1, 2, 3]


def test_padding_is_marked_as_absent():
    batch = collate([made(3), made(5)])
    assert batch.present.sum(dim=1).tolist() == [3, 5]
    assert batch.terminal.nonzero().tolist() == [[0, 2], [1, 4]]
    assert batch.curvttc[0, 4:].isinf().all()
