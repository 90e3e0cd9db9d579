"""What a stranger in the ROS domain sends is refused, counted and shown, and every node goes on with what is right."""

import re
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from nodes.stage import Stage, action_message, overrides, safety_bytes, state_bytes
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header, UInt64

from vpsci_msgs.msg import AgentAction, EpisodeEvent, PolicyWeights, SafetyState, Transition, VehicleControl, WorldState
from vpsci_ros.bags.info import bag_info
from vpsci_ros.bags.reader import Bag
from vpsci_ros.learning.transitions import TRANSITION
from vpsci_ros.nodes import convert
from vpsci_ros.nodes.agent_policy import VehiclePolicy
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.config import section_classes
from vpsci_ros.nodes.intake import second_publishers
from vpsci_ros.nodes.learner import Learner
from vpsci_ros.nodes.recorder import Recorder
from vpsci_ros.nodes.safety_monitor import SafetyMonitor
from vpsci_ros.nodes.topics import LOCK_STEP
from vpsci_ros.nodes.world_simulator import WorldSimulator
from vpsci_ros.parameters import table
from vpsci_ros.world import EPISODE, RUNNING
from vpsci_ros.world.lockstep import LockStepConfig

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


NO_DISTANCE = safety(2, distance=[np.nan])
BAD_STATES = [state(1)[:-40], state(1, vehicle_x=np.nan), serialize_message(WorldState(tick=1))]


def test_a_monitor_refuses_bad_states_and_answers_the_next_one(context: Context, stage: Callable[..., Stage]) -> None:
    monitor = SafetyMonitor(context=context)
    here, answered = stage(monitor, peer="world_simulator"), []
    here.peer.create_subscription(SafetyState, "safety/state", lambda m: answered.append(m.tick), LOCK_STEP)
    here.peer.create_subscription(WorldState, "world/state", lambda _: None, LOCK_STEP)
    sender = here.peer.create_publisher(WorldState, "world/state", LOCK_STEP)
    here.spin_until(lambda: sender.get_subscription_count() == 2 and monitor._safety.matched)
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
    for bad in (safety(2)[:-8], safety(2, curvttc=[np.nan]), NO_DISTANCE):
        policy.intake.receive("/safety/state", bad)
    policy.intake.receive("/world/state", state(2))
    policy.intake.receive("/safety/state", safety(2))
    here.spin_until(lambda: answered == [0, 2])
    assert refused(policy) == {"/world/state": 3, "/safety/state": 3}


@pytest.mark.parametrize(
    "values", [{}, {"scenarios": [99999]}, {"batch": "many"}, {"scenario_files": ["none.yaml"]}, {"batch": 2}]
)
def test_a_recorder_takes_parameters_of_its_run_and_refuses_replies_that_are_none(
    context: Context, stage: Callable[..., Stage], tmp_path: Path, values: dict[str, Any]
) -> None:
    recorder = Recorder(context=context, parameter_overrides=overrides(bag=str(tmp_path / "bag")))
    stage(recorder)
    names = [row.name for kind in section_classes("world_simulator", {}) for row in table(kind)]
    given = [Parameter(name, value=values.get(name)).get_parameter_value() for name in names]
    future = Future()
    future.set_result(GetParameters.Response(values=given if values else given[1:]))
    recorder._peer_parameters._on_reply("world_simulator", names, future)
    taken = values == {"batch": 2}
    assert ("world_simulator" not in recorder._peer_parameters.missing) == taken
    assert refused(recorder) == ({} if taken else {"/world_simulator/get_parameters": 1})
    recorder.close()


def test_a_recorder_refuses_bytes_that_are_no_message(
    context: Context, stage: Callable[..., Stage], tmp_path: Path
) -> None:
    recorder = Recorder(context=context, parameter_overrides=overrides(bag=str(tmp_path / "bag")))
    stage(recorder)
    for topic in ("/vehicle/cmd_control", "/diagnostics", "/episode/event"):
        recorder._take(topic, b"\x00\x01\x00\x00" + b"\xff" * 40)
    recorder.close()
    assert refused(recorder) == {"/vehicle/cmd_control": 1, "/diagnostics": 1, "/episode/event": 1}


def test_a_recorder_refuses_states_and_answers_that_the_other_nodes_refuse(
    context: Context, stage: Callable[..., Stage], tmp_path: Path
) -> None:
    recorder = Recorder(context=context, parameter_overrides=overrides(bag=str(tmp_path / "bag")))
    stage(recorder)
    recorder._on_parameters("world_simulator", {"batch": 1, "pedestrians": 1})
    header = Header(stamp=convert.stamp(1, PERIOD), frame_id=convert.MAP)
    good, bad = np.zeros((1, 2)), (np.zeros((2, 2)), np.full((1, 2), np.nan))
    sent = {
        "/world/state": [state(1), *BAD_STATES, state(1, batch=2)],
        "/safety/state": [safety(1), safety(1, curvttc=[np.nan]), safety(1, distance=np.zeros(2))],
        "/vehicle/action": [serialize_message(action_message(header, 1, pairs, 1)) for pairs in (good, *bad)],
    }
    for topic, messages in sent.items():
        for message in messages:
            recorder._take(topic, message)
    recorder.close()
    assert refused(recorder) == {topic: len(messages) - 1 for topic, messages in sent.items()}
    info = bag_info(tmp_path / "bag")
    assert (info["messages_seen"], info["messages"]) == (11, 3)


def test_a_recorder_writes_what_others_sent_with_zeros_between_its_fields(
    context: Context, stage: Callable[..., Stage], tmp_path: Path
) -> None:
    recorder = Recorder(context=context, parameter_overrides=overrides(bag=str(tmp_path / "bag")))
    stage(recorder)
    command = VehicleControl(tick=3, steer=0.5, header=Header(frame_id="a"))
    clean = serialize_message(command).replace(b"a\0\0\0", b"a\0\x07\x07")
    recorder._take("/vehicle/cmd_control", clean)
    recorder.close()
    (raw,) = Bag(tmp_path / "bag").messages(["/vehicle/cmd_control"])
    assert b"\x07" not in bytes(raw.data)
    assert deserialize_message(bytes(raw.data), VehicleControl) == command


CODES = [*range(11), 255]  # of types of a parameter's value; 10 and 255 are none


def test_a_node_refuses_parameters_that_are_none_and_takes_those_that_are(
    context: Context, stage: Callable[..., Stage]
) -> None:
    world = WorldSimulator(context=context)
    here = stage(world)
    one = here.peer.create_client(SetParameters, "world_simulator/set_parameters")
    all_at_once = here.peer.create_client(SetParametersAtomically, "world_simulator/set_parameters_atomically")
    here.spin_until(lambda: one.service_is_ready() and all_at_once.service_is_ready())

    def ask(client: Any, kind: Any, given: list[Any]) -> Any:
        reply = client.call_async(kind.Request(parameters=given))
        here.spin_until(reply.done)
        return reply.result()

    for name in ("", "action_timeout", "seed", "no_such"):
        odd = [ParameterMessage(name=name, value=ParameterValue(type=code)) for code in CODES]
        replies = ask(one, SetParameters, odd).results
        assert [code for code, reply in zip(CODES, replies, strict=True) if reply.successful] == [], name
        assert not any(ask(all_at_once, SetParametersAtomically, [each]).result.successful for each in odd)
    good = Parameter("action_timeout", value=7.0).to_parameter_msg()
    assert [each.successful for each in ask(one, SetParameters, [odd[-1], good]).results] == [False, True]
    assert world.config(LockStepConfig).action_timeout == 7.0


def test_a_policy_that_waits_for_weights_refuses_what_is_none(context: Context, stage: Callable[..., Stage]) -> None:
    policy = VehiclePolicy(context=context)
    stage(policy)
    policy.intake.receive("/policy/weights", PolicyWeights(version=3, safetensors=array("B", b"not weights")))
    assert refused(policy) == {"/policy/weights": 1}
    assert policy.figures()["policy_version"] == 0


def test_a_learner_refuses_transitions_that_are_ragged_or_not_numbers_and_learns_on(
    context: Context, stage: Callable[..., Stage], weights: str, tmp_path: Path
) -> None:
    chosen = {"stage": "refine", "weights": weights, "output": str(tmp_path)}
    learner = Learner(context=context, parameter_overrides=overrides(**chosen))
    stage(learner, peer="world_simulator").peer.create_subscription(UInt64, "replay/consumed", lambda _: None, 1)
    assert learner._refiner is not None
    rows = np.zeros(4, TRANSITION)
    rows["number"], rows["step"], rows["scenario"] = np.arange(4), np.arange(4), 1
    rows["vehicle_observation"][3] = np.nan
    ragged = convert.filled(convert.transition_message(rows, 4, PERIOD), {"vehicle_action": array("f", [0.0])})
    for message in (ragged, Transition(), convert.transition_message(rows, 4, PERIOD)):
        learner.intake.receive("/replay", message)
    assert refused(learner) == {"/replay": 1}
    learner._report(learner._refiner.summary())
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
    here.spin_until(lambda: sum(topic.seen for topic in recorder._bag.topics.values()) == 4)
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


def test_a_policy_that_gives_no_answer_is_named_at_once(
    context: Context, stage: Callable[..., Stage], capfd: pytest.CaptureFixture[str]
) -> None:
    chosen = {"scenarios": [1], "pedestrian_driver": "autopilot", "vehicle_driver": "policy", "action_timeout": 60.0}
    world = WorldSimulator(context=context, parameter_overrides=overrides(**chosen, spawn="paper"))
    here = stage(world, SafetyMonitor(context=context))
    silent = here.add(rclpy.create_node("vehicle_policy", context=context))
    silent.create_publisher(AgentAction, "vehicle/action", LOCK_STEP)
    silent.create_subscription(WorldState, "world/state", lambda _: None, LOCK_STEP)
    here.spin_until(lambda: world.state == "running")
    said: list[str] = []

    def logged(pattern: str) -> bool:
        said.append(capfd.readouterr().err)
        return re.search(pattern, "".join(said)) is not None

    here.spin_until(lambda: logged(r"no answer to tick 0 from vehicle_policy for [1-9]"))
    assert world.status().awaited == ["vehicle_policy"]


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
