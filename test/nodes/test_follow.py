"""What ends a run of a graph, with processes and a watch that are made up: restarts, pauses, requests."""

from types import SimpleNamespace
from typing import Any

import pytest

from vpsci_ros.nodes.config import GraphConfig
from vpsci_ros.nodes.graph import _follow
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.nodes.watch import Watch
from vpsci_ros.runs.sections import Sections
from vpsci_ros.runs.stop_request import StopRequest
from vpsci_ros.world.counts import WorldCounts


class Processes:
    """Processes that end with given statuses, one list of exit statuses by node after another."""

    leader = "world_simulator"
    logs = "log"
    running = ("world_simulator", "vehicle_policy")

    def __init__(self, *ends: dict[str, int]) -> None:
        self._ends = list(ends)
        self.started: list[str] = []
        self._polls = 0

    def ended(self) -> dict[str, int]:
        return self._ends.pop(0) if self._ends else {}

    def start(self, node: str) -> None:
        self.started.append(node)

    def statuses(self, _: float) -> dict[str, NodeStatus]:
        self._polls += 1
        assert self._polls < 1000, "the run goes on for ever"
        return {}

    def explain(self, node: str) -> str:
        return f"{node} ended"


def watch(paused: float = 0.0, idle: float = 0.0) -> Any:
    return SimpleNamespace(
        take=lambda _: None, pause_for=lambda *_: None, paused_time=lambda: paused, idle_time=lambda: idle
    )


def follow(processes: Processes, seen: Any = None, *, made: bool = False, **graph: Any) -> str:
    request = StopRequest()
    if made:
        request.set()
    return _follow(processes, seen or watch(), GraphConfig(**graph), request, lambda *_: "")  # type: ignore[arg-type]


@pytest.mark.parametrize("status", [1, -9, -11])
def test_a_policy_that_fails_is_started_again_as_often_as_restarts_says(status: int) -> None:
    processes = Processes({"vehicle_policy": status}, {"world_simulator": 0})
    assert follow(processes, restarts=1) == ""
    assert processes.started == ["vehicle_policy"]
    again = Processes(*[{"vehicle_policy": status}] * 2)
    assert follow(again, restarts=1) == "vehicle_policy ended"


@pytest.mark.parametrize(("node", "status"), [("vehicle_policy", 2), ("vehicle_policy", 0), ("safety_monitor", 1)])
def test_a_refused_parameter_and_the_end_of_another_node_end_the_run(node: str, status: int) -> None:
    assert follow(Processes({node: status}), restarts=5) == f"{node} ended"


def test_a_world_that_somebody_pauses_stands_still_for_so_long_and_no_longer() -> None:
    assert "paused for 30 s (graph.pause_timeout)" in follow(Processes(), watch(paused=31.0), pause_timeout=30.0)
    assert follow(Processes({"world_simulator": 0}), watch(paused=29.0), pause_timeout=30.0) == ""


def test_a_request_to_stop_ends_the_run_whatever_else_happens() -> None:
    assert follow(Processes({"vehicle_policy": -9}), made=True) == "stopped on request"


def test_the_time_of_a_pause_is_counted_from_the_world_s_own_word_and_ends_with_it() -> None:
    seen = Watch(Sections({"graph": {}, "world_simulator": {}}), quiet=True)

    def reports(state: str) -> None:
        seen.take({"world_simulator": NodeStatus(state=state)})

    reports("running")
    assert seen.paused_time() == 0.0
    reports("paused")
    first = seen.paused_time()
    reports("paused")
    assert seen.paused_time() >= first >= 0.0
    assert seen._paused_since is not None
    reports("running")
    assert seen.paused_time() == 0.0


def test_a_run_is_idle_from_when_no_node_but_the_recorder_reports_anything_new(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("vpsci_ros.nodes.watch.time.monotonic", lambda: now[0])
    seen = Watch(Sections({"graph": {}, "world_simulator": {}}), quiet=True)
    for second, ticks, written in ((101.0, 1, 5), (102.0, 2, 9), (103.0, 2, 13), (104.0, 2, 17)):
        now[0] = second
        world = NodeStatus(counts=WorldCounts(tick=ticks))
        seen.take({"world_simulator": world, "recorder": NodeStatus(figures={"messages_written": written})})
    assert seen.idle_time() == 2.0
