"""An external driving system's commands: what is taken, what is refused, and what happens where none comes."""

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.lockstep.external_driver import ExternalDriver
from vpsci_ros.world import EPISODE, RUNNING
from vpsci_ros.world.state import SAFE_STOP
from vpsci_ros.world.tick import Tick

PERIOD, NANOSECONDS = 0.05, 50_000_000


class Session:
    """A driver, and ticks for it."""

    def __init__(self, *, real_time: bool = False) -> None:
        self.counts = WorldCounts()
        self.driver = ExternalDriver(real_time, PERIOD, self.counts)
        self.state = np.zeros(1, EPISODE)
        self.state["status"], self.state["frame"] = RUNNING, 5

    def begin(self, number: int, *, running: bool = True) -> None:
        self.driver.begin(Tick(number=number, state=self.state, policy_frame=np.zeros(1, bool)), running=running)

    def braking(self) -> float:
        actions, _ = self.driver.drive(self.state)
        assert actions.vehicle is not None
        return float(-actions.vehicle[0, 0])


@pytest.mark.parametrize("value", [np.nan, 50.1])
def test_a_command_that_nothing_can_follow_is_refused_and_counted(value: float) -> None:
    session = Session()
    session.begin(3)
    with pytest.raises(InvalidInput, match="at tick 3: out of range or not finite"):
        session.driver.accelerate((value, 0.0))
    assert not session.driver.answered
    assert session.counts.nonzero() == {"vehicle_commands_refused": 1}


def test_commands_for_other_ticks_are_refused_by_their_stamp_or_their_tick() -> None:
    session = Session()
    session.begin(3)
    with pytest.raises(InvalidInput, match="an earlier tick"):
        session.driver.accelerate((0.0, 0.0), 2 * NANOSECONDS)
    with pytest.raises(InvalidInput, match="an earlier tick"):
        session.driver.control((0.0, 0.0, 1.0), tick=2)
    with pytest.raises(InvalidInput, match="a tick that has not been"):
        session.driver.control((0.0, 0.0, 1.0), tick=4)
    session.driver.control((0.0, 0.0, 1.0), stamp=1, tick=3)
    session.driver.accelerate((0.0, 0.0))
    counts = {"vehicle_commands": 2, "vehicle_commands_surplus": 1, "vehicle_commands_refused": 3}
    counts["vehicle_commands_ahead"] = 1
    assert session.counts.nonzero() == counts


def test_who_was_waited_for_in_vain_and_has_left_is_not_waited_for_again() -> None:
    session = Session()
    session.begin(3)
    session.begin(4)
    assert not session.driver.answered
    session.driver.present = lambda: False
    assert session.driver.answered
    session.driver.accelerate((0.0, 0.0))
    session.begin(5)
    assert not session.driver.answered


def test_in_real_time_the_vehicle_rolls_until_the_first_command_and_the_last_one_holds() -> None:
    session = Session(real_time=True)
    session.begin(0)
    assert session.driver.answered
    assert session.braking() == 0.0
    session.driver.accelerate((-1.5, 0.0))
    for number in range(1, 11):  # up to 0.5 s
        session.begin(number)
        assert session.braking() == 1.5


def test_a_safe_stop_brakes_ever_more_firmly_up_to_its_limit_and_is_reported_once() -> None:
    session = Session(real_time=True)
    session.begin(0)
    session.driver.accelerate((1.0, 0.0))
    braking, kinds = [], []
    for number in range(1, 35):
        session.begin(number)
        actions, events = session.driver.drive(session.state)
        assert actions.vehicle is not None
        braking.append(-float(actions.vehicle[0, 0]))
        kinds += events["kind"].tolist()
    assert braking == pytest.approx([-1.0] * 10 + [0.25 * k for k in range(1, 21)] + [5.0] * 4)
    assert kinds == [SAFE_STOP]
    assert (session.counts.safe_stops, session.counts.safe_stop_ticks) == (1, 24)


@pytest.mark.parametrize("real_time", [False, True])
def test_a_command_stamped_in_the_future_is_refused_and_locks_no_later_one_out(real_time: bool) -> None:
    session = Session(real_time=real_time)
    session.begin(10)
    for stamp in (10 * NANOSECONDS + 1, 1_700_000_000 * 10**9):  # a moment ahead; by the wall clock
        with pytest.raises(InvalidInput, match=f"{stamp} ns is ahead of simulated time, 500000000 ns"):
            session.driver.accelerate((-1.0, 0.0), stamp)
    session.driver.accelerate((-2.0, 0.0), 10 * NANOSECONDS)
    assert session.braking() == 2.0
    counts = {"vehicle_commands_refused": 2, "vehicle_commands_ahead": 2, "vehicle_commands": 1}
    assert session.counts.nonzero() == counts


def test_a_late_answer_to_a_tick_that_was_published_twice_is_no_fault_and_a_third_one_is() -> None:
    session = Session()
    session.begin(0)
    session.driver.repeat()
    session.driver.accelerate((-1.0, 0.0), 0)
    assert session.driver.answered
    session.begin(1)
    for _ in range(2):  # an answer to the odometry, and one to the list of objects
        session.driver.accelerate((-1.0, 0.0), 0)
    assert not session.driver.answered
    assert session.counts.nonzero() == {"vehicle_commands": 1}
    with pytest.raises(InvalidInput, match="an earlier tick"):
        session.driver.accelerate((-1.0, 0.0), 0)
