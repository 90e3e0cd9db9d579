"""Who yielded: made-up encounters whose answer is plain, and real ones rated by eye."""

import numpy as np
import pytest

from vpsci_ros.safety import CRITICAL_TTC, Yielded, curvttc, who_goes_first, who_yielded

DT = 0.1
STEPS = 120


def encounter(vehicle_speed, walking_speed, *, vehicle_from=-25.0, walker_from=-8.0):
    """Series of a car along x and a pedestrian along y from the speeds of each step; the paths cross at the origin."""
    speed, pace = np.broadcast_to(vehicle_speed, STEPS) * 1.0, np.broadcast_to(walking_speed, STEPS) * 1.0
    x, ped_y = (begin + np.cumsum(v) * DT for begin, v in ((vehicle_from, speed), (walker_from, pace)))
    nothing = np.zeros(STEPS)
    ttc = curvttc(x, 0.0, 0.0, speed, 0.0, 0.0, ped_y, 0.0, pace)
    assert ttc.min() < CRITICAL_TTC
    return x, nothing, nothing, speed, nothing, ped_y, nothing, pace, ttc


def ramp(first, last, begin, end):
    """A speed that goes from `first` to `last` between two times [s]."""
    return np.interp(np.arange(STEPS) * DT, [begin, end], [first, last])


CAR_STOPS = encounter(ramp(5.0, 0.0, 1.0, 6.0), 1.4)
CAR_SLOWS = encounter(ramp(5.0, 2.5, 1.0, 3.0), 1.4, vehicle_from=-30.0)
WALKER_STOPS = encounter(5.0, ramp(1.4, 0.0, 2.0, 4.0), walker_from=-6.5)
WALKER_WAITS = encounter(4.0, np.where(np.arange(STEPS) < 30, 1.4, np.where(np.arange(STEPS) < 80, 0.2, 1.4)))
NOBODY = encounter(ramp(4.0, 5.0, 2.0, 4.0), 1.4, walker_from=-10.6)  # the car hurries a little, and is through
BOTH_STOP = encounter(ramp(5.0, 0.0, 1.0, 6.0), ramp(1.4, 0.0, 2.0, 4.0), walker_from=-6.5)
PARKED = encounter(0.0, 1.4, vehicle_from=0.0)


@pytest.mark.parametrize(
    ("series", "answer"),
    [
        (CAR_STOPS, Yielded.VEHICLE),
        (CAR_SLOWS, Yielded.VEHICLE),
        (WALKER_STOPS, Yielded.PEDESTRIAN),
        (WALKER_WAITS, Yielded.PEDESTRIAN),
        (NOBODY, Yielded.NONE),
        (BOTH_STOP, Yielded.BOTH),
        (PARKED, Yielded.NONE),
    ],
    ids=["car stops", "car slows", "walker stops", "walker waits", "nobody", "both stop", "parked"],
)
def test_plain_encounters(series, answer):
    assert Yielded(int(who_yielded(*series, dt=DT))) == answer


def test_without_a_critical_step_nobody_yields():
    *state, ttc = CAR_STOPS
    assert who_yielded(*state, np.full_like(ttc, np.inf), dt=DT) == Yielded.NONE


def test_a_padded_batch_is_its_episodes_one_by_one():
    episodes = [CAR_STOPS, [part[:70] for part in WALKER_STOPS], [part[:90] for part in NOBODY], BOTH_STOP]
    batch = np.full((9, len(episodes), STEPS), np.nan)
    for row, episode in enumerate(episodes):
        for k, series in enumerate(episode):
            batch[k, row, : len(series)] = series
    got = who_yielded(*batch, dt=DT, lengths=[len(episode[0]) for episode in episodes])
    np.testing.assert_array_equal(got, [who_yielded(*episode, dt=DT) for episode in episodes])
    assert set(got) == {0, 1, 2, 3}


@pytest.mark.parametrize(
    ("series", "first"),
    [(CAR_STOPS, 1.0), (CAR_SLOWS, 1.0), (WALKER_STOPS, 0.0), (WALKER_WAITS, 0.0), (NOBODY, 0.0), (BOTH_STOP, np.nan)],
    ids=["car stops", "car slows", "walker stops", "walker waits", "nobody", "both stop"],
)
def test_the_first_at_the_crossing_goes_first_and_it_is_open_where_both_stop_before_it(series, first):
    x, y, heading, _, ped_x, ped_y = series[:6]
    np.testing.assert_array_equal(who_goes_first(x, y, heading, ped_x, ped_y), first)


def test_who_goes_first_in_a_padded_batch_is_that_of_its_episodes():
    chosen, ends = [0, 1, 2, 4, 5], (STEPS, 70, 90)
    batch = np.full((5, 3, STEPS), np.nan)
    for row, episode in enumerate((CAR_STOPS, WALKER_STOPS, NOBODY)):
        for k, column in enumerate(chosen):
            batch[k, row, : ends[row]] = episode[column][: ends[row]]
    assert who_goes_first(*batch, lengths=ends).tolist() == [1.0, 0.0, 0.0]
