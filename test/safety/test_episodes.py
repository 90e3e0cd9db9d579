"""Onset, conflict, least CurvTTC, collision and clearance of one episode and of padded batches."""

import math

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import is_collision, is_conflict, least_clearance, least_curvttc, onset

INF = math.inf


def test_onset_is_the_first_step_at_or_below_five_seconds():
    assert onset([INF, 7.0, 5.0, 4.0, INF]) == 2
    assert onset([INF, 5.001]) == -1
    assert onset([3.0]) == 0
    assert onset([8.0, 6.0, 5.0], critical=6.0) == 1


def test_a_conflict_is_below_two_seconds_at_any_step():
    assert is_conflict([INF, 1.999, 4.0])
    assert not is_conflict([INF, 2.0, 4.0])
    assert least_curvttc([INF, 2.5, 4.0]) == 2.5


def test_a_collision_is_touching_at_any_step():
    assert is_collision([0.4, 0.0, 0.3])
    assert not is_collision([0.4, 1e-9, 0.3])
    assert least_clearance([0.4, -0.2, 0.3]) == -0.2


def test_steps_beyond_a_rows_length_may_hold_anything():
    ttc = np.array([[6.0, 4.0, 1.0], [INF, math.nan, -3.0], [7.0, 6.0, math.nan]])
    lengths = [2, 1, 2]
    np.testing.assert_array_equal(onset(ttc, lengths=lengths), [1, -1, -1])
    np.testing.assert_array_equal(is_conflict(ttc, lengths=lengths), [False, False, False])
    np.testing.assert_array_equal(least_curvttc(ttc, lengths=lengths), [4.0, INF, 6.0])
    np.testing.assert_array_equal(is_collision(ttc - 6.0, lengths=lengths), [True, False, True])


@pytest.mark.parametrize("lengths", [[0, 1], [1, 4], [1.0, 2.0]])
def test_lengths_that_do_not_fit_are_refused(lengths):
    with pytest.raises(InvalidInput, match="lengths"):
        onset(np.ones((2, 3)), lengths=lengths)
