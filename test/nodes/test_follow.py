"""What ends a run of a graph, with processes and a watch that are made up."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.nodes.graph import NodeProcesses, _follow
from vpsci_ros.nodes.node_config import GraphConfig
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.nodes.watch import Watch
from vpsci_ros.runs.processes import CoreTime, core_time
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.stop_request import StopRequest


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

    def hindered(self) -> float:
        return 0.0

    def explain(self, node: str) -> str:
        return f"{node} ended"


def watch(idle: float = 0.0) -> Any:
    return SimpleNamespace(take=lambda _: None, excuse=lambda _: None, idle_time=lambda: idle)


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


class Numbered(NamedTuple):
    """A process of which only the number is known."""

    pid: str


def test_time_in_which_a_node_starts_or_waits_for_a_core_is_no_standstill(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 100 s without a report 70 s are excused; what came before the last report does not count."""
    now = [100.0]
    monkeypatch.setattr("vpsci_ros.nodes.watch.time.monotonic", lambda: now[0])
    seen = Watch(Sections({"graph": {}, "world_simulator": {}}), quiet=True)
    now[0] = 200.0
    seen.excuse(70.0)
    assert seen.idle_time() == 30.0
    seen.take({"world_simulator": NodeStatus(counts=WorldCounts(tick=1))})
    assert seen.idle_time() == 0.0


def test_what_a_process_computes_excuses_it_until_all_its_nodes_have_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """[computed, waited] of the processes of the monitor, which has reported, and of the policy, which has not."""
    times = {"1": [[10.0, 1.0], [15.0, 1.5]], "2": [[3.0, 1.0], [3.75, 1.25]]}
    monkeypatch.setattr("vpsci_ros.nodes.graph.core_time", lambda pid: CoreTime(*times[pid].pop(0)))
    processes = NodeProcesses(["world_simulator", "safety_monitor", "pedestrian_policy"], tmp_path, tmp_path)
    reported, silent = SimpleNamespace(latest=NodeStatus()), SimpleNamespace(latest=None)
    own = {"safety_monitor": Numbered("1"), "pedestrian_policy": Numbered("2")}
    monkeypatch.setattr(processes, "running", own)
    monkeypatch.setattr(processes, "_pipes", {"safety_monitor": reported, "pedestrian_policy": silent})
    processes.hindered()
    assert processes.hindered() == 1.0, "the policy computed for 0.75 s and waited for 0.25 s; the monitor waited 0.5 s"


@pytest.mark.skipif(not Path("/proc/self/schedstat").is_file(), reason="this system does not tell")
def test_a_thread_that_computes_has_a_core_time() -> None:
    before = core_time()
    assert any(core_time().computed > before.computed for _ in range(10**6))
    assert core_time("none") == CoreTime()
