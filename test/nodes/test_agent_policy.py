"""A policy's book-keeping, message by message: two topics that overtake each other are not two ticks lost."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from nodes.stage import Stage, overrides, safety_bytes, state_bytes
from rclpy.context import Context

from vpsci_msgs.msg import AgentAction
from vpsci_ros.errors import VpsciError
from vpsci_ros.nodes.agent_policy import UNPAIRED, VehiclePolicy
from vpsci_ros.nodes.topics import LOCK_STEP
from vpsci_ros.wire import layout
from vpsci_ros.wire.layout import safety_state
from vpsci_ros.world import EPISODE, RUNNING


class Session(Stage):
    """A vehicle policy that answers, and a reader of its answers; where it has `begun`, it has answered tick 0."""

    def __init__(self, context: Context, weights: str, *, begun: bool = True) -> None:
        self.answered: list[int] = []
        self.policy = VehiclePolicy(context=context, parameter_overrides=overrides(weights=weights, seed=1))
        super().__init__(context, self.policy, peer="world_simulator")
        self.peer.create_subscription(AgentAction, "vehicle/action", lambda m: self.answered.append(m.tick), LOCK_STEP)
        self.offered(self.policy)
        if begun:
            self.state(0)
            self.safety(0)
            self.spin_until(lambda: self.answered == [0])

    def state(self, tick: int, controlled: int = 0) -> None:
        """Send `/world/state`: one episode, at a policy frame at every other tick."""
        state = np.zeros(1, EPISODE)
        state["status"], state["controlled"] = RUNNING, controlled
        self.policy.intake.receive("/world/state", state_bytes(state, [tick % 2 == 0], tick))

    def safety(self, tick: int) -> None:
        """Send `/safety/state` of a scene without danger."""
        self.policy.intake.receive("/safety/state", safety_bytes(tick, [np.inf], [np.inf], [False]))


@pytest.fixture
def session(context: Context, weights: str, closed: Callable[[Any], Any]) -> Session:
    return closed(Session(context, weights))


# The world does not wait for policies at tick 1, so the next state may be here before the monitor's answer to it.
@pytest.mark.parametrize("order", ["state 1, state 2, safety 1, safety 2", "safety 1, state 1, safety 2, state 2"])
def test_topics_that_overtake_each_other_are_answered_once(session: Session, order: str) -> None:
    send = {"state": session.state, "safety": session.safety}
    for topic, tick in (message.split() for message in order.split(", ")):
        send[topic](int(tick))
    session.spin_until(lambda: session.answered == [0, 2])


# A policy that was stopped for a while finds the states of ticks that went on without it, and the answers to them.
@pytest.mark.parametrize("order", ["state 2, state 4, safety 2, safety 4", "safety 2, safety 4, state 2, state 4"])
def test_a_policy_that_was_stopped_answers_every_tick_in_its_queues(session: Session, order: str) -> None:
    send = {"state": session.state, "safety": session.safety}
    for topic, tick in (message.split() for message in order.split(", ")):
        send[topic](int(tick))
    session.spin_until(lambda: session.answered == [0, 2, 4])


def test_of_messages_without_the_other_one_of_their_tick_only_the_latest_are_kept(session: Session) -> None:
    ticks = range(2, 2 * UNPAIRED + 4, 2)
    for send in (session.state, session.safety):
        for tick in ticks:
            send(tick)
    session.spin_until(lambda: session.answered == [0, *ticks[1:]])


def test_a_safety_state_is_checked_once_and_only_where_the_policy_acts_by_it(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    checked: list[int] = []

    def check(safety: Any, batch: int) -> Any:
        checked.append(safety.tick)
        return safety_state(safety, batch)

    monkeypatch.setattr(layout, "safety_state", check)
    for tick in (1, 2, 3):
        session.state(tick)
        session.safety(tick)
    session.spin_until(lambda: session.answered == [0, 2])
    assert checked == [2]


def test_another_world_begins_with_its_first_tick(session: Session) -> None:
    for tick in (2, 0):
        session.state(tick)
        session.safety(tick)
    session.spin_until(lambda: session.answered == [0, 2, 0])


def test_it_says_when_it_is_ready_and_how_it_acts(
    capfd: pytest.CaptureFixture[str], weights: str, session: Session
) -> None:
    said = [line.partition("[vehicle_policy]: ")[2] for line in capfd.readouterr().err.splitlines()]
    assert [text for text in said if text] == [f"ready: answers /world/state on /vehicle/action, weights {weights}"]


def test_a_policy_that_was_not_there_at_a_hand_over_ends_with_the_episode_s_name(
    context: Context, weights: str, closed: Callable[[Any], Any]
) -> None:
    session = closed(Session(context, weights, begun=False))
    session.state(8, controlled=1)
    with pytest.raises(VpsciError, match=r"tick 8: episode 0:0 was handed over before this policy"):
        session.safety(8)
