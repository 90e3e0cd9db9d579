"""What a stranger in the ROS domain sends is refused, counted and shown, and every node goes on with what is right."""

from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from nodes.stage import Stage, action_message, overrides, safety_bytes, state_bytes
from rclpy.context import Context
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header, UInt64

from vpsci_msgs.msg import AgentAction, EpisodeEvent, PolicyWeights, SafetyState, Transition, WorldState
from vpsci_ros.bags.info import bag_info
from vpsci_ros.nodes import convert
from vpsci_ros.nodes.agent_policy import VehiclePolicy
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.intake import second_publishers
from vpsci_ros.nodes.learner import Learner
from vpsci_ros.nodes.recorder import Recorder
from vpsci_ros.nodes.safety_monitor import SafetyMonitor
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.nodes.topics import LOCK_STEP
from vpsci_ros.nodes.world_simulator import WorldSimulator
from vpsci_ros.world import EPISODE, RUNNING
from vpsci_ros.world.transition import TRANSITION

PERIOD = 0.05


def state(tick: int, batch: int = 1, **changed: Any) -> bytes:
    """Return `/world/state` of running episodes at a policy frame."""
    record = np.zeros(batch, EPISODE)
    record["status"], record["scenario"] = RUNNING, 1
    for name, values in changed.items():
        record[name] = values
    return state_bytes(record, np.ones(batch, bool), tick)


def safety(tick: int, curvttc: Any = (np.inf,), distance: Any = (1.0,)) -> bytes:
    return safety_bytes(tick, curvttc, distance, [False])


def refused(node: GraphNode) -> dict[str, int]:
    return {topic.removeprefix("refused "): n for topic, n in node.status().pairs().items() if "refused /" in topic}


def level(status: NodeStatus) -> bytes:
    """Return the level of a node's diagnostics."""
    (only,) = convert.diagnostics_message("node", status, Time()).status
    return only.level


NO_DISTANCE = safety(2, distance=[np.nan])
BAD_STATES = [state(1)[:-40], state(1, vehicle_x=np.nan), serialize_message(WorldState(tick=1))]


def test_a_monitor_refuses_bad_states_and_answers_the_next_one(context: Context, stage: Callable[..., Stage]) -> None:
    monitor = SafetyMonitor(context=context)
    here, answered = stage(monitor, peer="world_simulator"), []
    here.peer.create_subscription(SafetyState, "safety/state", lambda m: answered.append(m.tick), LOCK_STEP)
    here.peer.create_subscription(WorldState, "world/state", lambda _: None, LOCK_STEP)
    sender = here.peer.create_publisher(WorldState, "world/state", LOCK_STEP)
    here.spin_until(lambda: sender.get_subscription_count() == 2)
    for message in [*BAD_STATES, state(2)]:
        sender.publish(message)
    here.spin_until(lambda: answered == [2])
    assert refused(monitor) == {"/world/state": 3}


def test_a_policy_refuses_bad_messages_and_answers_the_next_one(
    context: Context, stage: Callable[..., Stage], weights: str
) -> None:
    policy = VehiclePolicy(context=context, parameter_overrides=overrides(weights=weights))
    here, answered = stage(policy, peer="world_simulator"), []
    here.peer.create_subscription(AgentAction, "vehicle/action", lambda m: answered.append(m.tick), LOCK_STEP)
    here.offered(policy)
    policy.intake.receive("/world/state", state(0))
    policy.intake.receive("/safety/state", safety(0))
    here.spin_until(lambda: answered == [0])
    for bad in BAD_STATES:
        policy.intake.receive("/world/state", bad)
    policy.intake.receive("/world/state", state(2))
    for bad in (safety(2)[:-8], safety(2, curvttc=[np.nan]), NO_DISTANCE):
        policy.intake.receive("/safety/state", bad)
    policy.intake.receive("/safety/state", safety(2))
    here.spin_until(lambda: answered == [0, 2])
    assert refused(policy) == {"/world/state": 3, "/safety/state": 3}
    assert level(policy.status()) == DiagnosticStatus.ERROR
    assert level(NodeStatus(state="waiting")) == level(NodeStatus(awaited=["learner"])) == DiagnosticStatus.WARN
    assert level(NodeStatus()) == DiagnosticStatus.OK


def test_a_policy_that_waits_for_weights_refuses_what_is_none(context: Context, stage: Callable[..., Stage]) -> None:
    policy = VehiclePolicy(context=context)
    stage(policy)
    policy.intake.receive("/policy/weights", PolicyWeights(version=3, safetensors=array("B", b"not weights")))
    assert refused(policy) == {"/policy/weights": 1}
    assert policy.figures()["policy_version"] == 0


def test_a_learner_refuses_transitions_that_are_ragged_or_not_numbers_and_learns_on(
    context: Context, stage: Callable[..., Stage], weights: str, near_misses_file: Path, tmp_path: Path
) -> None:
    chosen = {"stage": "refine", "weights": weights, "output": str(tmp_path), "near_misses": [str(near_misses_file)]}
    learner = Learner(context=context, parameter_overrides=overrides(**chosen))
    stage(learner, peer="world_simulator").peer.create_subscription(UInt64, "replay/consumed", lambda _: None, 1)
    rows = np.zeros(4, TRANSITION)
    rows["number"], rows["step"], rows["scenario"], rows["acting"] = np.arange(4), np.arange(4), 1, 1
    rows["vehicle_observation"][3] = np.nan
    ragged = convert.filled(convert.transition_message(rows, 4, PERIOD), {"vehicle_action": array("f", [0.0])})
    for message in (ragged, Transition(), convert.transition_message(rows, 4, PERIOD)):
        learner.intake.receive("/replay", message)
    assert refused(learner) == {"/replay": 1}
    assert (learner.figures()["transitions"], learner.figures()["refused"]) == (4, 1)


def test_a_recorder_leaves_out_ragged_events_and_times_before_0_and_its_bag_is_whole(
    context: Context, stage: Callable[..., Stage], tmp_path: Path
) -> None:
    recorder = Recorder(context=context, parameter_overrides=overrides(bag=str(tmp_path / "bag")))
    here = stage(recorder)
    clocks = here.peer.create_publisher(Clock, "clock", LOCK_STEP)
    events = here.peer.create_publisher(EpisodeEvent, "episode/event", LOCK_STEP)
    here.spin_until(lambda: clocks.get_subscription_count() > 0 and events.get_subscription_count() > 0)
    good = EpisodeEvent(tick=1, header=Header(stamp=convert.stamp(1, PERIOD)))
    ragged = EpisodeEvent(tick=1, kind=[EpisodeEvent.ENDED], slot=[0, 0])
    for message in (Clock(clock=convert.stamp(1, PERIOD)), Clock(clock=convert.Time(sec=-5))):
        clocks.publish(message)
    for message in (good, ragged):
        events.publish(message)
    here.spin_until(lambda: recorder.figures()["messages_seen"] >= 4)
    assert refused(recorder) == {"/clock": 1, "/episode/event": 1}
    recorder.close()
    info = bag_info(tmp_path / "bag")
    assert (info["messages_seen"], info["messages_written"], info["messages"]) == (4, 2, 2)
    assert info["damage"] == []


def test_a_second_publisher_of_actions_is_named_and_what_it_says_otherwise_is_counted(
    context: Context, stage: Callable[..., Stage]
) -> None:
    chosen = {"scenarios": [1], "episodes": 1, "batch": 1, "pedestrian_driver": "autopilot", "vehicle_driver": "policy"}
    world = WorldSimulator(context=context, parameter_overrides=overrides(**chosen))
    here = stage(world, SafetyMonitor(context=context), peer="stranger")
    own = here.add(rclpy.create_node("vehicle_policy", context=context))
    for node, acceleration in ((own, 0.5), (here.peer, -8.0)):
        answer_every_state(node, acceleration)
    here.spin_until(lambda: world.finished)
    world.intake.look()
    assert "/stranger on /vehicle/action" in world.status().second_publishers
    assert world.counts.vehicle_answers_contradicted > 0


def answer_every_state(node: Any, acceleration: float) -> None:
    sender = node.create_publisher(AgentAction, "vehicle/action", LOCK_STEP)

    def answer(message: WorldState) -> None:
        sender.publish(action_message(message.header, message.tick, np.full((1, 2), acceleration), 1))

    node.create_subscription(WorldState, "world/state", answer, LOCK_STEP)


@pytest.mark.parametrize(
    ("names", "second"),
    [
        (["/vehicle_policy"], []),
        (["/left/vehicle_policy", "/stranger"], ["/stranger"]),
        (["/vehicle_policy", "/vehicle_policy"], ["/vehicle_policy"]),
        (["/replayer"], []),
        (["/a", "/b"], ["/a", "/b"]),
    ],
)
def test_whoever_publishes_beside_the_first_is_a_second_publisher(names: list[str], second: list[str]) -> None:
    assert second_publishers(names, ("vehicle_policy",)) == second
