"""Whether a graph of nodes did all that was asked of it: episodes, answers, and messages in its bag.

Every number here is one that a node or the bag tells of itself; a run is complete only if they agree.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

ANSWERS = {"safety_monitor": "safety", "vehicle_policy": "vehicle", "pedestrian_policy": "pedestrian"}
PUBLISHED = "world_simulator.published "  # what the keys of the numbers of published messages begin with


@dataclass(frozen=True)
class RecordedCounts:
    """Messages of a bag by topic: those that came to the recorder, were refused by it, written, and are in the bag."""

    seen: Mapping[str, int] = field(default_factory=dict)
    refused: Mapping[str, int] = field(default_factory=dict)
    written: Mapping[str, int] = field(default_factory=dict)
    held: Mapping[str, int] = field(default_factory=dict)


def what_is_missing(
    asked: int, nodes: Collection[str], progress: Mapping[str, float], recorded: RecordedCounts | None
) -> list[str]:
    """Say what a run lacks that ended without an error, one clause each; nothing where it is complete.

    :param asked: episodes that were asked for; 0 where no world runs.
    :param nodes: of the graph.
    :param progress: numbers of the run by name: "episodes_ended", and the nodes' diagnostics as "node.key".
    :param recorded: of its bag; None where the graph has no recorder.
    """
    missing = []
    ended = int(progress.get("episodes_ended", 0))
    if ended < asked:
        missing.append(f"{ended} of {asked} episodes ended")
    for node, sender in ANSWERS.items():
        absent, other, early = (
            int(progress.get(f"world_simulator.{sender}_answers_{what}", 0))
            for what in ("missing", "contradicted", "early")
        )
        if node in nodes and absent:
            missing.append(f"{absent} answers of {node} are missing")
        if other:
            missing.append(f"{other} answers contradict those of {node}: somebody else answered, too")
        if early:
            missing.append(f"{early} answers for {node} came before their tick: somebody else published, too")
    return missing + (_not_recorded(progress, recorded) if recorded else [])


def _not_recorded(progress: Mapping[str, float], recorded: RecordedCounts) -> list[str]:
    missing = []
    for topic, seen in recorded.seen.items():
        refused, written = recorded.refused.get(topic, 0), recorded.written.get(topic, 0)
        if seen - refused != written:
            missing.append(f"the recorder wrote {written} of {seen - refused} messages on {topic}")
    published = {name: int(count) for name, count in progress.items() if name.startswith(PUBLISHED)}
    for name, count in published.items():
        topic = name.removeprefix(PUBLISHED)
        held = recorded.held.get(topic, 0)
        if held < count:
            missing.append(f"the bag holds {held} of {count} messages on {topic}")
    return missing
