"""The onset of one episode and of a batch."""

import math

import numpy as np

from vpsci_ros.safety import onset

INF = math.inf


def test_onset_is_the_first_step_at_or_below_five_seconds():
    assert onset([INF, 7.0, 5.0, 4.0, INF]) == 2
    assert onset([INF, 5.001]) == -1
    assert onset([3.0]) == 0
    assert onset([8.0, 6.0, 5.0], critical=6.0) == 1
    np.testing.assert_array_equal(onset([[6.0, 4.0], [INF, 7.0]]), [1, -1])
