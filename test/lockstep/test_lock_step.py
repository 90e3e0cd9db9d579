"""Lock-step: the world goes on when everybody has answered, or has been waited for; not while it has to stand still."""

from collections.abc import Callable

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.lockstep.external_driver import ExternalDriver
from vpsci_ros.lockstep.lock_step import REPLAY_WINDOW, LockStep
from vpsci_ros.lockstep.simulator_config import SimulatorConfig
from vpsci_ros.world import EPISODE, RUNNING, WorldConfig
from vpsci_ros.world.tick import Assessment, Tick

PATIENT = SimulatorConfig(action_timeout=2.0)


class Session:
    """A lock-step with two slots, and those who answer it."""

    def __init__(self, external: ExternalDriver | None = None, **drivers: str) -> None:
        self.counts = WorldCounts()
        self.lock_step = LockStep(PATIENT, WorldConfig(**drivers), self.counts, external)
        self.state = np.zeros(2, EPISODE)
        self.state["status"] = RUNNING

    def begin(self, number: int = 0, now: float = 0.0) -> None:
        policy_frame = np.full(2, number % 2 == 0)
        self.lock_step.begin(Tick(number=number, state=self.state, policy_frame=policy_frame), now)

    def monitor(self, number: int = 0, ttc: float = 1.0) -> None:
        def read(tick: Tick) -> Assessment:
            return tick.assessed(np.full(2, ttc), np.ones(2), np.ones(2, bool))

        self.lock_step.take_assessment(number, read)

    def agent(self, agent: str, number: int = 0, value: float = 1.0) -> None:
        self.lock_step.take_action(number, agent, 7, lambda _: np.full((2, 2), value))

    def answer(self, number: int = 0) -> None:
        self.monitor(number)
        for agent in ("vehicle", "pedestrian"):
            self.agent(agent, number)


@pytest.fixture
def session() -> Session:
    return Session()


@pytest.mark.parametrize("last", ["monitor", "vehicle", "pedestrian"])
def test_at_a_policy_tick_the_world_goes_on_with_the_last_answer(session: Session, last: str) -> None:
    session.begin()
    answers: dict[str, Callable[[], None]] = {"monitor": session.monitor}
    answers |= {agent: lambda agent=agent: session.agent(agent) for agent in ("vehicle", "pedestrian")}  # type: ignore[misc]
    final = answers.pop(last)
    for answer in answers.values():
        answer()
    assert not session.lock_step.may_advance()
    final()
    assert session.lock_step.may_advance()
    assessment, actions, events = session.lock_step.answers()
    assert assessment.acting.all()
    assert actions.vehicle is not None
    assert actions.pedestrian is not None
    assert session.lock_step.versions == {"vehicle": 7, "pedestrian": 7}
    assert len(events) == 0


@pytest.mark.parametrize("begun", [False, True], ids=["before the first tick", "at a tick"])
def test_an_answer_to_a_tick_that_is_still_to_come_is_refused_and_counted(session: Session, begun: bool) -> None:
    if begun:
        session.begin()
    for answer in (session.monitor, lambda number: session.agent("vehicle", number)):
        with pytest.raises(InvalidInput, match="expected no answer to tick 3 yet, which is still to come"):
            answer(3)
    assert session.counts.nonzero() == {"safety_answers_early": 1, "vehicle_answers_early": 1}
    session.begin(3)
    session.answer(3)
    assert session.lock_step.may_advance()
    assert session.lock_step.versions == {"vehicle": 7, "pedestrian": 7}


def test_who_does_not_answer_is_waited_for_until_the_timeout_and_left_out(session: Session) -> None:
    session.begin(now=10.0)
    session.begin(2, now=10.0)
    session.monitor(2)
    session.agent("vehicle", 2)
    assert not session.lock_step.may_advance(12.0)
    assert session.lock_step.may_advance(12.1)
    assert not session.lock_step.may_advance()
    assert session.lock_step.answers()[1].pedestrian is None


def test_a_bad_answer_is_refused_counted_and_nobody_waits_for_a_better_one(session: Session) -> None:
    session.begin()
    with pytest.raises(InvalidInput, match="curvttc of slot 0 is not a number"):
        session.monitor(ttc=np.nan)
    with pytest.raises(InvalidInput, match="actions.vehicle of slot 0"):
        session.agent("vehicle", value=np.inf)
    session.agent("pedestrian")
    assert session.counts.nonzero() == {"safety_answers_refused": 1, "vehicle_answers_refused": 1}
    assert session.lock_step.may_advance()
    assessment, actions, _ = session.lock_step.answers()
    assert not assessment.answered
    assert actions.vehicle is None
    assert actions.pedestrian is not None


@pytest.mark.parametrize("late", [False, True], ids=["to the present tick", "to a tick that is over"])
def test_a_second_answer_that_differs_is_refused_and_counted_and_the_first_stands(session: Session, late: bool) -> None:
    session.begin()
    session.answer()
    if late:
        session.begin(1)
        session.monitor(1)
    with pytest.raises(InvalidInput, match="expected one answer to tick 0, got another that differs; the first stands"):
        session.agent("vehicle", value=9.0)
    with pytest.raises(InvalidInput, match="another that differs"):
        session.monitor(ttc=3.0)
    assert session.counts.nonzero() == {"vehicle_answers_contradicted": 1, "safety_answers_contradicted": 1}
    assert late or session.lock_step.actions.vehicle.max() == 1.0  # type: ignore[union-attr]
    assert session.lock_step.assessment.curvttc.max() == 1.0  # type: ignore[union-attr]


def test_paced_by_the_wall_clock_a_tick_waits_for_its_beat_and_late_ones_are_counted(session: Session) -> None:
    session.lock_step.pace(True)
    session.begin()
    session.answer()
    assert not session.lock_step.may_advance()
    assert not session.lock_step.may_advance(99.0)
    session.lock_step.beat()
    assert session.lock_step.may_advance()
    assert session.counts.late_ticks == 0
    session.lock_step.beat()
    assert session.counts.late_ticks == 1
    session.begin(2)
    session.answer(2)
    session.lock_step.pace(False)
    assert session.lock_step.may_advance()


def test_the_world_waits_for_a_learner_that_is_a_window_behind_however_long(session: Session) -> None:
    session.begin()
    session.answer()
    session.lock_step.unread = REPLAY_WINDOW
    assert not session.lock_step.may_advance(1e9)
    session.lock_step.unread = REPLAY_WINDOW - 1
    assert session.lock_step.may_advance()


def test_an_external_pedestrian_acts_at_every_tick_at_which_an_episode_runs() -> None:
    session = Session(vehicle_driver="autopilot", pedestrian_driver="external")
    session.begin(1)
    session.monitor(1)
    assert not session.lock_step.may_advance()
    session.agent("pedestrian", 1)
    assert session.lock_step.may_advance()
    session.state["status"] = 0
    session.begin(2)
    session.monitor(2)
    assert session.lock_step.may_advance()


def test_an_external_vehicles_command_stands_in_for_a_policys_action() -> None:
    driver = ExternalDriver(False, 0.05, WorldCounts())
    session = Session(driver, vehicle_driver="external")
    session.begin()
    session.monitor()
    session.agent("pedestrian")
    assert not session.lock_step.may_advance()
    driver.control((0.5, 0.0, 1.0))
    assert session.lock_step.may_advance()
    _, actions, _ = session.lock_step.answers()
    assert actions.vehicle is None
    assert actions.vehicle_control is not None
    assert actions.vehicle_control.tolist() == [[0.5, 0.0, 1.0]] * 2  # in both rows of the episode
    assert actions.pedestrian is not None
