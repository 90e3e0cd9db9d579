"""When a run of a graph is idle, with reports and processes that are made up."""

from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import pytest

from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.nodes.graph import NodeProcesses
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.nodes.watch import Watch
from vpsci_ros.runs.processes import CoreTime, core_time
from vpsci_ros.runs.run_config import Sections


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
