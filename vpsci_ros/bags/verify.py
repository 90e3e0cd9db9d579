"""Verification of a bag: its episodes are simulated again in this process and compared bit by bit.

Messages of `/world/state`, `/episode/event`, `/safety/state` and the policies' actions are compared, field by field; a
second one for a tick is a difference, a missing one is named. Answers that the world did without, because a node was
late or away, are known from the events in the bag and left out here as well. What could not be compared is named. A
parameter that this version lacks is passed over: one that mattered shows as a difference.
"""

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.bags.episodes import recorded_from_bag
from vpsci_ros.bags.reader import Bag, opened
from vpsci_ros.bags.run_record import BagRun, bag_run
from vpsci_ros.errors import InvalidInput
from vpsci_ros.lockstep.counts import MISSING_ANSWERS
from vpsci_ros.lockstep.intervention import read_changes
from vpsci_ros.lockstep.simulator_config import SimulatorConfig
from vpsci_ros.parameters import pick
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.agent_types import make_agent
from vpsci_ros.policy.policy_config import PolicyConfig
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.provenance import cpu_name
from vpsci_ros.runs.run_config import RunConfig
from vpsci_ros.wire import layout
from vpsci_ros.wire.decoder import decode
from vpsci_ros.wire.layout import EVENTS, SAFETY, WORLD
from vpsci_ros.world import Scenario, World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Agent, Loop
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.scenario import scenario_from
from vpsci_ros.world.state import SAFE_STOP

_LATE = 1000  # ticks by which a message may stand later in the file: what the recorder's queue of each topic holds
Fields = Mapping[str, NDArray[Any] | None]
Messages = dict[str, list[Any]]  # by topic
_NOTHING: Messages = {}


@dataclass
class VerifiedBag:
    """The result of `verify_bag`: what was compared, and the first difference.

    :ivar ticks, episodes, values: how many ticks, episode starts and numbers were compared.
    :ivar difference: the first one, in words; empty: none.
    :ivar uncompared: which parts of the run were not compared and why, one sentence each; empty: all was compared.
    :ivar notes: what else is worth knowing, one sentence each.
    """

    ticks: int = 0
    episodes: int = 0
    values: int = 0
    difference: str = ""
    uncompared: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def verify_bag(bag: str | Path | Bag, *, weights: str = "") -> VerifiedBag:
    """Simulate the episodes of a bag again and compare the messages of world, monitor and policies at every tick.

    :param weights: a weights file, or a shipped name, to take in place of the one that the bag names.
    :raises InvalidInput: no bag, or one that cannot be simulated again, for the reason in the message.
    """
    bag = opened(bag)
    simulation = _Simulation(bag, bag_run(bag), weights)
    result = VerifiedBag()
    absent = expected = 0
    ticks = itertools.chain(_ticks(bag, result), [(0, _NOTHING)])
    for (tick, messages), (_, following) in itertools.pairwise(ticks):
        if expected == 0 and tick > 0:
            raise InvalidInput(f"{bag.path} cannot be simulated again: its first tick is {tick}, the beginning is lost")
        while expected < tick and not simulation.done:  # what is lost is simulated as if no answer had been missing
            absent += 1
            simulation.take_actions()
            simulation.advance(set())
            expected += 1
        missing = _missing_answers(following)
        result.difference = simulation.compare(tick, messages, missing if following else None, result)
        if result.difference:
            break
        simulation.advance(missing)
        expected += 1
    if result.ticks == 0 and not result.difference:
        raise InvalidInput(f"{bag.path} cannot be simulated again: it holds no message of {WORLD}")
    if absent:
        plural = "s" * (absent > 1)
        result.uncompared += (f"the bag lacks {absent} tick{plural} between its first and its last one",)
    if bag.path.is_dir() and not (bag.path / "metadata.yaml").is_file() and not simulation.done:
        result.uncompared += ("metadata.yaml is missing: whether the bag lost what came after its last tick",)
    for topic, count in simulation.absent.items():
        result.uncompared += (f"the bag lacks {count} message{'s' * (count > 1)} of {topic}",)
    if result.difference and simulation.cpu not in ("", cpu_name()):
        result.notes += (f"it was recorded on another kind of CPU, {simulation.cpu}; here is {cpu_name()}",)
    return result


class _Simulation:
    """The world, monitor and policies that a bag names."""

    def __init__(self, bag: Bag, run: BagRun, weights: str) -> None:
        self._where = f"{bag.path} cannot be simulated again"
        world = run.parameters.get("world_simulator")
        if world is None and "learner" in run.parameters:
            raise InvalidInput(
                f"{self._where}: it is of stage 1, in which a learner reads a table and nothing is simulated"
            )
        if world is None:
            raise InvalidInput(
                f"{self._where}: it does not hold the parameters of the nodes, which the recorder of vpsci_ros writes: "
                "another recorder wrote it, or the text records were lost when it was converted or filtered"
            )
        simulator = pick(SimulatorConfig, world, "world_simulator")
        if simulator.engine != "vpsci":
            raise InvalidInput(
                f"{self._where}: its agents were moved by engine = {simulator.engine}, which cannot be simulated again "
                "here"
            )
        config = pick(WorldConfig, world, "world_simulator")
        self.cpu = run.software.get("cpu", "")
        external = [agent for agent in AGENTS if getattr(config, f"{agent}_driver") == "external"]
        if external:
            raise InvalidInput(f"{self._where}: an external system drove the {' and the '.join(external)}")
        settings = {name: value for name, value in world.items() if name != "queue"}
        self._run = pick(RunConfig, settings, "world_simulator")
        recorded, changes = simulator.recorded_bag, simulator.episode_changes
        if recorded and not Path(recorded).exists():
            raise InvalidInput(f"{self._where}: its agents replay the bag {recorded}, which is not here")
        if changes and not Path(changes).exists():
            raise InvalidInput(f"{self._where}: its pedestrians have the head starts in {changes}, which is not here")
        queue = [(scenario, number) for scenario, number in world["queue"]] if "queue" in world else self._run.queue()
        simulated = World(
            config,
            self._scenarios(run),
            queue,
            self._run.batch,
            self._run.seed,
            recorded_from_bag(recorded) if recorded else None,
            head_starts=read_changes(changes)[0] if changes else None,
        )
        agents = [agent for agent in AGENTS if getattr(config, f"{agent}_driver") == "policy"]
        self._loop = Loop(simulated, {agent: self._policy(agent, run, weights) for agent in agents})
        self._events = simulated.take_started()  # of the present tick
        self._recorded = frozenset(bag.topics())
        self.absent: Counter[str] = Counter()
        """Messages that the bag lacks although the world had them, by topic."""

    def _scenarios(self, run: BagRun) -> list[Scenario]:
        """Return the scenarios of the run: the package's, if they are still the same, and those in the bag."""
        own = [scenario_from(document, f"{self._where}: {name}") for name, document in run.own_scenarios.items()]
        scenarios = load_scenarios(self._run.scenarios, own)
        for scenario in scenarios:
            if scenario.sha256 and run.scenario_files.get(scenario.name, scenario.sha256) != scenario.sha256:
                raise InvalidInput(
                    f"{self._where}: scenario {scenario.name} is another one in this version of vpsci_ros"
                )
        return scenarios

    def _policy(self, agent: str, run: BagRun, weights: str) -> Agent:
        node = f"{agent}_policy"
        if run.refreshes:
            raise InvalidInput(f"{self._where}: a learner changed the weights while it was recorded")
        if node not in run.parameters:
            raise InvalidInput(f"{self._where}: it does not hold the parameters of {node}")
        config = pick(PolicyConfig, run.parameters[node], node)
        policy = make_agent(agent, config)
        if not isinstance(policy, PolicyAgent):
            return policy
        digest, remedy = run.weights.get(node, ""), "give that file by --weights"
        try:
            path = weights_path(weights or config.weights)
        except InvalidInput as error:
            raise InvalidInput(
                f"{self._where}: {node} acted by weights of SHA-256 {digest}; {error}; {remedy}"
            ) from None
        if digest and sha256(path) != digest:
            raise InvalidInput(
                f"{self._where}: {node} acted by weights {config.weights} of SHA-256 {digest}, but {path} has "
                f"{sha256(path)}; {remedy}"
            )
        policy.load(load_policy(path), version=1)
        return policy

    @property
    def done(self) -> bool:
        """Whether every episode has ended."""
        return self._loop.world.done

    def take_actions(self) -> None:
        """Have the policies act at the world's tick, which they do once."""
        self._actions = self._loop.actions()

    def compare(self, tick: int, messages: Messages, missing: set[str] | None, result: VerifiedBag) -> str:
        """Compare all messages of the world's tick; return the first difference in words, "" for none.

        :param missing: whose answers to the tick the world did without; None: it is the last one, and nobody waited.
        """
        simulated: dict[str, Fields] = {}
        happened = _deterministic(self._events)
        if len(happened) or messages.get(EVENTS):
            simulated[EVENTS] = layout.event_fields(happened)
            recorded = (layout.event_fields(_deterministic(rows)) for rows in messages.get(EVENTS, ()))
            messages = messages | {EVENTS: [SimpleNamespace(**fields) for fields in recorded]}
        if not self.done:
            simulated |= self._tick(result)
        elif set(messages) - {EVENTS}:
            return f"tick {tick}: every episode has ended before it when simulated again, but the bag goes on"
        for topic, fields in simulated.items():
            held = messages.get(topic, ())
            for message in held:
                if found := _compare(f"tick {tick}, {topic}", message, fields, result):
                    return found
            if len(held) > 1:
                return f"tick {tick}, {topic}: {len(held)} messages in the bag, one simulated"
            answers = topic not in (WORLD, EVENTS) and not any(values is None for values in fields.values())
            waited = answers and missing is not None and topic.split("/")[1] not in missing
            if not held and topic in self._recorded and (waited or topic in (WORLD, EVENTS)):
                self.absent[topic] += 1
        return ""

    def _tick(self, result: VerifiedBag) -> dict[str, Fields]:
        """Return topic -> the fields of its simulated message at the world's tick, of world, monitor and policies."""
        self.take_actions()
        _, state, frame, _ = self._loop.world.now
        assessed = self._loop.assessment
        result.ticks += 1
        result.episodes += int(np.count_nonzero((state["status"] != 0) & (state["frame"] == 0)))
        simulated: dict[str, Fields] = {
            WORLD: layout.world_state_fields(state, frame),
            SAFETY: {name: getattr(assessed, name) for name in ("curvttc", "distance", "critical")},
        }
        for agent in self._loop.agents:
            action = self._actions.of(agent)
            longitudinal, lateral = (None, None) if action is None else action.T
            simulated[f"/{agent}/action"] = {"longitudinal": longitudinal, "lateral": lateral}
        return simulated

    def advance(self, missing: set[str]) -> None:
        """Move to the next tick, without the answers that the recorded world did without."""
        loop = self._loop
        if not self.done:
            assessment = loop.world.now.unassessed() if "safety" in missing else loop.assessment
            actions = replace(self._actions, **dict.fromkeys(missing - {"safety"}))
            self._events = loop.advance(assessment, actions).events


def _compare(where: str, message: Any, simulated: Fields, result: VerifiedBag) -> str:
    """Return the first field in which a message differs from what was simulated, empty for none."""
    for name, values in simulated.items():
        recorded: Any = getattr(message, name, None)
        if values is None:
            return f"{where}: the policy answered, but not when simulated again"
        again = np.ascontiguousarray(values).astype(recorded.dtype)
        result.values += len(again)
        if len(again) != len(recorded):
            return f"{where}.{name}: {len(recorded)} entries in the bag, {len(again)} simulated"
        if again.tobytes() != recorded.tobytes():
            bits = [part.view(f"u{part.dtype.itemsize}") for part in (np.ascontiguousarray(recorded), again)]
            slot = int(np.argmax(bits[0] != bits[1]))
            return f"{where}.{name}[{slot}]: {recorded[slot]!s} in the bag, {again[slot]!s} simulated"
    return ""


def _ticks(bag: Bag, result: VerifiedBag) -> Iterator[tuple[int, Messages]]:
    """Yield the ticks of a bag in order with all their messages by topic; events are EVENT[n]."""
    topics = (WORLD, SAFETY, EVENTS, *(f"/{agent}/action" for agent in AGENTS))
    gathered: dict[int, Messages] = {}
    newest, given, late = -1, -1, 0
    for raw in bag.messages(topics):
        message = decode(raw, bag.path)
        tick = int(message.tick)
        if tick <= given:
            late += 1
            continue
        if raw.topic == WORLD:
            newest = max(newest, tick)
        of_tick = gathered.setdefault(tick, {}).setdefault(raw.topic, [])
        of_tick.append(layout.events(message) if raw.topic == EVENTS else message)
        while (oldest := min(gathered)) < newest - _LATE:
            given = oldest
            yield oldest, gathered.pop(oldest)
    if late:
        result.uncompared += (f"{late} messages stand more than {_LATE} ticks late in the file",)
    yield from sorted(gathered.items())


def _deterministic(events: NDArray[np.void]) -> NDArray[np.void]:
    """Return the events, EVENT[n], that do not depend on how quickly the nodes answered."""
    return events[~np.isin(events["kind"], (*MISSING_ANSWERS, SAFE_STOP))]


def _missing_answers(following: Messages) -> set[str]:
    """Return whose answers were missing, by the events that the world published with the following tick."""
    kinds = {kind for rows in following.get(EVENTS, ()) for kind in rows["kind"].tolist()}
    return {sender for kind, sender in MISSING_ANSWERS.items() if kind in kinds}
