"""Graphs in whose ROS domain a stranger publishes at random, calls services and offers some, and what must hold.

docs/promises.md says what a stranger can and cannot do. A run among strangers ends with 0 only if its bag holds what
an undisturbed one holds, no more and no less; otherwise it says why. Nothing ends but on request, prints a
traceback, hangs or stays alive: whatever the stranger says, no node is to die of it. It falls silent after a while.

A stranger that replays calls `/world/history` itself, keeps the reply that the world has signed, offers the service in
the world's place from then on, and kills a policy, which requests its history when it is started again.

The world is begun again by whoever calls its service, so that a run which was reset may hold other episodes.
"""

import contextlib
import os
import random
import signal
import subprocess
import time
from array import array
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from chaos import mutate, processes
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.signals import SignalHandlerOptions

from vpsci_ros.bags.reader import Bag
from vpsci_ros.nodes.topics import SERVICES, TOPICS
from vpsci_ros.runs.record import RECORD, read_record
from vpsci_ros.wire.layout import WORLD

SETTINGS = (f"world_simulator.action_timeout={processes.PATIENT}", "graph.pause_timeout=10.0")
NAMES = ("stranger", "stranger", "graph_watch", *processes.NODES)
TOPIC_WAYS = ("fields", "fields", "fields", "blank", "again", "first", "bytes")
RESET, HISTORY = "/world/reset", "/world/history"
VICTIM, AT = "vehicle_policy", 20  # who is killed by a stranger that replays, and after how many states
_SET = {"set_parameters": SetParameters, "set_parameters_atomically": SetParametersAtomically}
_ASK = {"get_parameters": GetParameters, "describe_parameters": DescribeParameters, "list_parameters": ListParameters}
PARAMETERS = _SET | _ASK
NUMBERS = (float("nan"), float("inf"), -float("inf"), 1e308, -1e308, -0.0, 1e-308, -1.0, 1e9)
TEXTS = ("", "é", "a" * 10_000, "/", "nan", "-1", "world_simulator", "9" * 400, "\u202e")
EARLY = 0.1  # [s] between what is said before the world speaks
HEARD = QoSProfile(depth=50)
LARGE = 20_000  # [bytes]
STAYS = 20.0  # [s] from its first act: for as long as somebody floods or resets it, no run ends


class Act(NamedTuple):
    """What a stranger does: on which topic or to which service, in which way, how likely at a tick, how often then."""

    target: str
    way: str
    share: float
    burst: int

    def __str__(self) -> str:
        return f"{self.way} to {self.target}, {self.burst} at {self.share:.0%} of ticks"


class Stranger(NamedTuple):
    """Who it says it is, what it does, and whether it begins before the world does."""

    name: str
    acts: tuple[Act, ...]
    early: bool
    seed: int

    def __str__(self) -> str:
        return f"as {self.name}{', from the beginning' * self.early}: {'; '.join(map(str, self.acts))}"


def stranger(seed: int) -> Stranger:
    """Return the stranger of a case."""
    rng = random.Random(f"strangers/{seed}")
    acts = tuple(_act(rng) for _ in range(rng.choice((1, 1, 2, 4))))
    replays = any(act.way == "replay" for act in acts)  # it would fall silent before a slow world has begun
    return Stranger(rng.choice(NAMES), acts, rng.random() < 0.3 and not replays, seed)


def _act(rng: random.Random) -> Act:
    share, burst = rng.choice(((0.02, 1), (0.02, 200), (0.2, 1), (0.2, 5), (1.0, 1), (1.0, 5)))
    if rng.random() < 0.75:
        read = [name for name, row in TOPICS.items() if row.subscribers]
        return Act(rng.choice(read), rng.choice(TOPIC_WAYS), share, burst)
    if rng.random() < 0.2:
        return Act(HISTORY, "replay", 1.0, 1)
    service = rng.choice([name for name, row in SERVICES.items() if row.server == "world_simulator"])
    node = f"/{rng.choice(processes.NODES)}/{rng.choice([*_SET, *_SET, *_ASK])}"
    return Act(rng.choice((service, node, node)), rng.choice(("call", "offer")), share, min(burst, 5))


def run(folder: Path, among: Stranger) -> processes.Run:
    """Run a graph with a stranger in its domain, and wait for its end."""
    replays = any(act.way == "replay" for act in among.acts)
    settings = (*SETTINGS, "graph.restarts=3") if replays else SETTINGS
    return processes.run_beside(folder, settings, partial(_haunt, among))


def defects(case: processes.Run, among: Stranger, undisturbed: dict[str, str]) -> list[str]:
    """Return what does not hold of a run among strangers, one sentence each."""
    found = processes.defects_of_end(case)
    if case.status is None:
        return found
    record = read_record(case.folder / RECORD)
    if record is None:
        return [*found, f"status {case.status}, but no record"]
    if bool(case.status) != bool(record["error"]):
        found.append(f"status {case.status}, and the record says {record['error']!r}")
    ended = record["results"]["exit_status"]
    found += [f"{node} ended with {status}" for node, status in ended.items() if status]
    bag = case.folder / "bag"
    if not (bag / "metadata.yaml").is_file():
        return [*found, "its bag was not completed"]
    messages = list(processes.digests(Bag(bag)))
    end = max((at for _, at, _ in messages), default=0)
    held = Counter((f"{topic} {at}", digest) for topic, at, digest in messages if at < end or topic == WORLD)
    lost, more = Counter(undisturbed.items()) - held, held - Counter(undisturbed.items())
    if case.status == 0 and (lost or more) and all(act.target != RESET for act in among.acts):
        found.append(f"status 0, but its bag lacks {lost.total()} messages and holds {more.total()} others")
    return found


# ---- what the stranger does


def _haunt(among: Stranger, graph: subprocess.Popen[bytes], mark: str, domain: int) -> None:
    """Have the stranger act until the graph has ended."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context = Context()
    rclpy.init(context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor(context=context)
    node = rclpy.create_node(among.name, context=context, enable_rosout=False, start_parameter_services=False)
    executor.add_node(node)
    try:
        there, rng = _There(node, among, mark), random.Random(f"act/{among.seed}")
        deadline, leaves = time.monotonic() + processes.LIMIT, None
        while graph.poll() is None and time.monotonic() < (leaves or deadline):
            executor.spin_once(timeout_sec=EARLY)
            if there.ticks or among.early:
                leaves = leaves or min(time.monotonic() + STAYS, deadline)
                there.act(rng)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


class _There:
    """The stranger's ends of topics and services."""

    def __init__(self, node: Node, among: Stranger, mark: str) -> None:
        self._node, self._mark = node, mark
        self._acts = among.acts
        self._requested: Any = None
        self._kept: Any = None
        self._killed = False
        self._heard: dict[str, bytes] = {}
        self._first: dict[str, bytes] = {}
        self.ticks = 0
        self._done = 0
        self._said: Counter[str] = Counter()
        topics = {act.target for act in among.acts if act.target in TOPICS}
        self._writers = {
            name: node.create_publisher(TOPICS[name].type, TOPICS[name].ros_name, TOPICS[name].qos) for name in topics
        }
        for name in topics | {WORLD}:
            row, hear = TOPICS[name], partial(self._hear, name)
            node.create_subscription(row.type, row.ros_name, hear, HEARD, raw=True)  # what it says itself as well
        self._clients = {}
        for target in {act.target for act in among.acts} - topics:
            kind = SERVICES[target].type if target in SERVICES else PARAMETERS[target.rpartition("/")[2]]
            if any(act.way == "offer" for act in among.acts if act.target == target):
                node.create_service(kind, target, partial(self._reply, kind, random.Random(f"offer/{among.seed}")))
            else:
                self._clients[target] = kind, node.create_client(kind, target)

    def _reply(self, kind: Any, rng: random.Random, request: Any, response: Any) -> Any:
        """Answer in the place of a node: with nothing, in other lengths, or with values that it cannot have."""
        if kind is GetParameters:
            count = rng.choice((0, len(request.names), len(request.names), 3))
            response.values = [_parameter(rng).value for _ in range(count)]
        elif response.get_fields_and_field_types():
            for _ in range(rng.choice((0, 1, 3))):
                change(response, rng)
        return response

    def _hear(self, topic: str, data: bytes) -> None:
        if len(data) < LARGE:  # or what it makes of its own messages would grow and grow
            self._heard[topic] = data
            self._first.setdefault(topic, data)
        self.ticks += topic == WORLD

    def act(self, rng: random.Random) -> None:
        """Do at random what is to be done, once for every tick that was heard of since, and at least once."""
        for _ in range(max(1, min(self.ticks - self._done, 50))):
            for act in self._acts:
                if rng.random() < act.share:
                    self._do(act, rng)
        self._done = self.ticks

    def _do(self, act: Act, rng: random.Random) -> None:
        if act.way == "replay":
            self._replay()
            return
        for _ in range(act.burst):
            if act.target in TOPICS:
                with contextlib.suppress(RuntimeError):  # the middleware sends no more for the time being
                    self._writers[act.target].publish(self._message(act, rng))
                continue
            if act.target not in self._clients:
                continue  # it offers this one
            kind, client = self._clients[act.target]
            if client.service_is_ready():
                client.remove_pending_request(client.call_async(_request(kind, rng)))

    def _replay(self) -> None:
        """Keep a reply that the world has signed, offer it in its place, and kill a policy that will request one."""
        kind, client = self._clients[HISTORY]
        if self._kept is None and self._requested is None and client.service_is_ready():
            self._requested = client.call_async(kind.Request(after_tick=-1))
        if self._kept is None and self._requested is not None and self._requested.done():
            self._kept = self._requested.result()
            self._node.create_service(kind, HISTORY, lambda request, response: self._kept)
        if self._kept is not None and self.ticks > AT and not self._killed:
            self._killed = True
            for pid in processes._of_node(VICTIM, self._mark):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)

    def _message(self, act: Act, rng: random.Random) -> Any:
        kind = TOPICS[act.target].type
        known = self._first if act.way == "first" else self._heard
        heard = known.get(act.target) if act.way != "blank" else None
        if act.way == "bytes":
            return mutate.mutated(heard or serialize_message(kind()), rng, text=False)
        message = kind()
        with contextlib.suppress(Exception):  # what cannot be read, another of its acts has sent
            message = deserialize_message(heard, kind) if heard else message
        if act.way == "fields":
            for _ in range(rng.choice((1, 1, 2, 3))):
                change(message, rng)
        return message


def _request(kind: Any, rng: random.Random) -> Any:
    request = kind.Request()
    if kind in _SET.values():
        request.parameters = [_parameter(rng) for _ in range(rng.choice((0, 1, 1, 3)))]
    elif kind in (GetParameters, DescribeParameters):
        request.names = [_name(rng) for _ in range(rng.choice((0, 1, 3)))]
    elif request.get_fields_and_field_types():
        change(request, rng)
    return request


def _name(rng: random.Random) -> str:
    return rng.choice((*TEXTS, "action_timeout", "seed", "weights", "peers", "use_sim_time", "chunk_size"))


def _parameter(rng: random.Random) -> Parameter:
    """Return a parameter of a type that its value may not have, a code that there is not, or an unlikely value."""
    value = ParameterValue(type=rng.choice((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 255)))
    for _ in range(rng.choice((0, 2, 6))):
        change(value, rng, but=("type",))
    return Parameter(name=_name(rng), value=value)


def change(message: Any, rng: random.Random, but: tuple[str, ...] = ()) -> None:
    """Change a field of a message, of one within it, or the length of one of its arrays, to something unlikely."""
    kinds = {name: kind for name, kind in message.get_fields_and_field_types().items() if name not in but}
    name = rng.choice(list(kinds))
    before = getattr(message, name)
    with contextlib.suppress(AssertionError, OverflowError, TypeError):  # what the message's own class refuses
        setattr(message, name, _changed(before, kinds[name], rng))


def _changed(before: Any, kind: str, rng: random.Random) -> Any:
    if isinstance(before, bool):
        return not before
    if isinstance(before, int):
        return rng.choice(list(_whole_numbers(before, kind)))
    if isinstance(before, float):
        return rng.choice((*NUMBERS, before + 1.0, -before))
    if isinstance(before, str):
        return rng.choice(TEXTS)
    if isinstance(before, bytes):
        return bytes([rng.randrange(256)])
    if hasattr(before, "get_fields_and_field_types"):
        change(before, rng)
        return before
    return _other_sequence(before, kind, rng)


def _whole_numbers(before: int, kind: str) -> Iterator[int]:
    bits = int("".join(filter(str.isdigit, kind)) or 8)
    signed = kind.startswith("int")
    least, most = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
    near = (before - 1, before + 1, before + 3, before + 500, before + 100_000)
    yield from (number for number in (*near, 0, 1, 7, least, most, most // 2) if least <= number <= most)


def _other_sequence(before: Any, kind: str, rng: random.Random) -> Any:
    """Return an array of another length, or with one element that is unlikely."""
    after = before[:] if isinstance(before, array) else list(before)
    way = rng.choice(("empty", "shorter", "longer", "much longer", "element", "element", "element"))
    if not len(after):
        element: list[Any] = [] if "/" in kind else [""] if "string" in kind else [0]
        after.extend(element * rng.choice((1, 3, 1000)))
        return after
    if way == "element":
        place = rng.randrange(len(after))
        with contextlib.suppress(OverflowError, TypeError):
            after[place] = _changed(after[place], kind, rng)
        return after
    return {"empty": after[:0], "shorter": after[:-1], "longer": after + after[-1:], "much longer": after * 40}[way]
