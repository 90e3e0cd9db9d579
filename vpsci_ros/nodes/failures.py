"""The reasons for which a run of a graph fails, as sentences, from the nodes' reports.

While it runs: `ended`, `stands_still`, `hangs`, and of an exam `Silence`, `flood`, `never_came`, `second_publishers`.
At its end: `incomplete`. An empty text or list means that nothing failed.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

from vpsci_ros.documents import counted
from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.nodes.node_config import GraphConfig
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.runs.processes import ChildProcess

RESPONDENTS = {"safety_monitor": "safety", "vehicle_policy": "vehicle", "pedestrian_policy": "pedestrian"}
ADS = "an external driving system"  # among what the world waits for
UNMATCHED = "cannot be heard on"  # likewise, of a publisher of commands, before its topic
OPEN_TO_ALL = (
    "/markers",
    "/tf",
    "/tf_static",
    "/diagnostics",
    "/vehicle/cmd_accel",
    "/vehicle/cmd_control",
)  # to publish on
HANGS = 20  # answers of a node that are missing: a run that lacks any fails, and this one lacks more and more
LEAST_FLOOD = 2000  # commands; fewer are no flood, however few the ticks


@dataclass(frozen=True)
class RecordedCounts:
    """Numbers of messages by topic: received, refused and written by the recorder, and found in the bag."""

    seen: Mapping[str, int] = field(default_factory=dict)
    refused: Mapping[str, int] = field(default_factory=dict)
    written: Mapping[str, int] = field(default_factory=dict)
    held: Mapping[str, int] = field(default_factory=dict)


def ended(node: str, process: ChildProcess) -> str:
    """Return a sentence about the end of a node's process, with the last error in its log."""
    said = process.said("error")
    return f"{node} {process.end}" + (f": {said}" if said else "") + f" (log: {process.log})"


def waiting(statuses: Mapping[str, NodeStatus]) -> str:
    """Return a sentence with the waiting nodes and what each waits for; "" if none waits."""
    return "; ".join(f"{node} waits for {', '.join(each.awaited)}" for node, each in statuses.items() if each.awaited)


def stands_still(idle: float, graph: GraphConfig, logs: object, statuses: Mapping[str, NodeStatus]) -> str:
    """Return a sentence about missing progress and its reasons, after `graph.progress_timeout` of it; else "".

    :param idle: for how long no node has reported any progress [s].
    :param logs: folder of the nodes' logs.
    """
    if idle > graph.progress_timeout:
        missing = [f"no progress for {graph.progress_timeout:g} s", waiting(statuses), f"the nodes' logs are in {logs}"]
        return "; ".join(part for part in missing if part)
    return ""


def hangs(nodes: Collection[str], statuses: Mapping[str, NodeStatus], logs: object) -> str:
    """Return a sentence about the node with most missing answers, if they are `HANGS` or more; else ""."""
    world = statuses.get("world_simulator", NodeStatus()).counts or WorldCounts()
    counted = [(world.faults(sender)["missing"], node) for node, sender in RESPONDENTS.items() if node in nodes]
    missing, node = max(counted, default=(0, ""))
    if missing < HANGS:
        return ""
    return f"{missing} answers of {node} are missing: the run has failed (log: {logs}/{node}.log)"


class Silence:
    """Detects from the world's counts that a driving system has stopped publishing.

    It has, if it left `limit` ticks or more unanswered and answered no more than it left unanswered meanwhile.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._tick = self._missing = self._refused = self._ahead = 0

    def __call__(self, counts: WorldCounts) -> str:
        """Return a sentence about the silence and its reason; "" if the driving system publishes."""
        missing, refused = counts.vehicle_answers_missing, counts.vehicle_commands_refused
        if counts.tick < self._tick or missing - self._missing < 0.5 * (counts.tick - self._tick):
            self._tick, self._missing, self._refused = counts.tick, missing, refused
            self._ahead = counts.vehicle_commands_ahead
        if missing - self._missing < self._limit:
            return ""
        came = refused - self._refused
        why = f"the {came} that came were refused: late, not finite or out of range" if came else "none came"
        if ahead := counts.vehicle_commands_ahead - self._ahead:
            why = (
                f"{ahead} of the {came} that came are stamped ahead of simulated time, as by the wall clock: set "
                "use_sim_time of its nodes, or stamp each command with the message that it answers"
            )
        unanswered, ticks = missing - self._missing, counts.tick - self._tick
        return f"the ADS gave no usable command for {unanswered} of the last {ticks} ticks; {why}"


def flood(counts: WorldCounts, limit: int, *, late: bool) -> str:
    """Return a sentence if a driving system floods the world with commands; else "".

    :param limit: surplus commands a tick that are no flood yet.
    :param late: the first tick should have come by now.
    """
    ticks, surplus, early = counts.tick, counts.vehicle_commands_surplus, counts.vehicle_commands_early
    if surplus > max(limit * (ticks + 1), LEAST_FLOOD):
        return (
            f"the ADS floods: {surplus} commands beyond the first one of a tick in {ticks} ticks, more than "
            f"{limit} a tick"
        )
    if late and ticks == 0 and early > LEAST_FLOOD:
        return f"the ADS floods: {early} commands before the first tick, which never came"
    return ""


def never_came(counts: WorldCounts, idle: float, patience: float, awaited: Collection[str] = ()) -> str:
    """Return a sentence if a driving system has sent no command within `patience` [s]; else "".

    :param idle: time without progress [s].
    :param awaited: what the world waits for; while it waits for nodes, the driving system is not to blame.
    """
    if RESPONDENTS.keys() & awaited or "recorder" in awaited:
        return ""
    published = counts.vehicle_commands or counts.vehicle_commands_refused or counts.vehicle_commands_early
    if counts.tick or published or idle <= patience:
        return ""
    if unmatched := [each for each in awaited if UNMATCHED in each]:
        return f"the ADS's {'; '.join(unmatched)}; publish its commands reliably, as QoS depth 10 does"
    topics = "/vehicle/cmd_accel or /vehicle/cmd_control"
    return f"the ADS never published {topics}, in {patience:g} s (graph.progress_timeout)"


def second_publishers(statuses: Mapping[str, NodeStatus]) -> list[str]:
    """Return unexpected publishers on topics that are not `OPEN_TO_ALL`, as "/NODE on /TOPIC"."""
    second = {each for status in statuses.values() for each in status.second_publishers}
    return sorted(each for each in second if each.partition(" on ")[2] not in OPEN_TO_ALL)


def incomplete(
    requested: int,
    nodes: Collection[str],
    statuses: Mapping[str, NodeStatus],
    recorded: RecordedCounts | None,
    killed: Collection[str] = (),
) -> list[str]:
    """Return a clause for each thing that is missing or wrong in a run without an error; empty if it is complete.

    :param requested: episodes; 0 where no world runs.
    :param nodes: of the graph.
    :param statuses: the last one of each node, through its pipe.
    :param recorded: of its bag; None where the graph has no recorder.
    :param killed: nodes whose process ended with another status than 0, so that their last report may be a second old.
    """
    found = [f"{node} reported nothing" for node in nodes if node not in statuses]
    world = statuses.get("world_simulator", NodeStatus()).counts or WorldCounts()
    if world.episodes_ended < requested:
        found.append(f"{world.episodes_ended} of {requested} episodes ended")
    for node, sender in RESPONDENTS.items():
        missing, _, contradicted, early = world.faults(sender).values()
        if node in nodes and missing:
            found.append(f"{counted(missing, 'answer')} of {node} {'is' if missing == 1 else 'are'} missing")
        if contradicted:
            found.append(f"{contradicted} answers differ from the first ones of {node} to their ticks")
        if early:
            found.append(f"{early} answers for {node} came before their tick")
    found += [f"a second publisher: {each}" for each in second_publishers(statuses)]
    return found + (list(_not_recorded(statuses, recorded, killed)) if recorded else [])


def _not_recorded(
    statuses: Mapping[str, NodeStatus], recorded: RecordedCounts, killed: Collection[str]
) -> Iterator[str]:
    for topic, seen in recorded.seen.items():
        readable, written = seen - recorded.refused.get(topic, 0), recorded.written.get(topic, 0)
        if readable != written:
            yield f"the recorder wrote {written} of {readable} messages on {topic}"
    published: dict[str, int] = {}
    for status in statuses.values():
        for topic, number in status.published.items():
            published[topic] = published.get(topic, 0) + number
    unknown = {topic for node in killed if node in statuses for topic in statuses[node].published}
    for topic in sorted(published.keys() & recorded.seen.keys() - unknown):
        held = recorded.held.get(topic, 0)
        if held < published[topic] and topic != "/diagnostics":
            yield f"the bag holds {held} of {published[topic]} messages on {topic}"
        if held > published[topic] and topic not in OPEN_TO_ALL:
            yield f"the bag holds {held} messages on {topic}, the graph's nodes published {published[topic]}"
