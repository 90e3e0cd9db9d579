"""What ends a run of a graph, with processes and a watch that are made up."""

from types import SimpleNamespace
from typing import Any

import pytest

from vpsci_ros.nodes.config import GraphConfig
from vpsci_ros.nodes.graph import _follow
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.nodes.watch import Watch
from vpsci_ros.runs.config import Sections
from vpsci_ros.runs.stop_request import StopRequest
from vpsci_ros.world.counts import WorldCounts


class Processes:
    """Processes that end with given statuses, one list of exit statuses by node after another."""

    leader = "world_simulator"
    logs = "log"
    running = ("world_simulator", "vehicle_policy")

    def __init__(self, *ends: dict[str, int]) -> None:
        self._ends = list(ends)
        self._polls = 0

    def ended(self) -> dict[str, int]:
        return self._ends.pop(0) if self._ends else {}

    def statuses(self, _: float) -> dict[str, NodeStatus]:
        self._polls += 1
        assert self._polls < 1000, "the run goes on for ever"
        return {}

    def explain(self, node: str) -> str:
        return f"{node} ended"


def watch(idle: float = 0.0) -> Any:
    return SimpleNamespace(take=lambda _: None, idle_time=lambda: idle)


def follow(processes: Processes, seen: Any = None, *, made: bool = False, **graph: Any) -> str:
    request = StopRequest()
    if made:
        request.set()
    return _follow(processes, seen or watch(), GraphConfig(**graph), request, lambda *_: "")  # type: ignore[arg-type]


@pytest.mark.parametrize(("node", "status"), [("vehicle_policy", -9), ("vehicle_policy", 2), ("safety_monitor", 0)])
def test_the_end_of_any_node_but_the_leader_ends_the_run_with_its_name(node: str, status: int) -> None:
    assert follow(Processes({node: status})) == f"{node} ended"


def test_a_request_to_stop_ends_the_run_whatever_else_happens() -> None:
    assert follow(Processes({"vehicle_policy": -9}), made=True) == "stopped on request"


def test_a_world_that_is_paused_is_not_idle(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("vpsci_ros.nodes.watch.time.monotonic", lambda: now[0])
    seen = Watch(Sections({"graph": {}, "world_simulator": {}}), quiet=True)
    for second, state in ((101.0, "running"), (200.0, "paused"), (300.0, "paused")):
        now[0] = second
        seen.take({"world_simulator": NodeStatus(state=state)})
    assert seen.idle_time() == 0.0


def test_a_run_is_idle_from_when_no_node_but_the_recorder_reports_anything_new(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("vpsci_ros.nodes.watch.time.monotonic", lambda: now[0])
    seen = Watch(Sections({"graph": {}, "world_simulator": {}}), quiet=True)
    for second, ticks, written in ((101.0, 1, 5), (102.0, 2, 9), (103.0, 2, 13), (104.0, 2, 17)):
        now[0] = second
        world = NodeStatus(counts=WorldCounts(tick=ticks))
        seen.take({"world_simulator": world, "recorder": NodeStatus(figures={"messages_written": written})})
    assert seen.idle_time() == 2.0
