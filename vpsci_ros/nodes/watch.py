"""Watching a run of a graph: for how long nothing has happened in it, and its progress on standard error."""

import contextlib
import time
from typing import Any

from vpsci_ros.nodes import failures
from vpsci_ros.nodes.config import GraphConfig
from vpsci_ros.nodes.standstill import Standstill
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.runs.config import RunConfig
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.sections import Sections

SHOWN = ("updates", "refreshes", "rollbacks", "closed_loop_ade", "held_out_closed_loop_ade")


class Watch:
    """Takes the nodes' reports and shows progress; use it in a `with` block.

    :param resolved: parameters of the graph.
    :param quiet: show nothing.
    """

    def __init__(self, resolved: Sections, *, quiet: bool = False) -> None:
        graph = resolved.get(GraphConfig, "graph")
        self._total = resolved.get(RunConfig, "world_simulator").total if "world_simulator" in resolved.values else 0
        self._last = time.monotonic()
        self._paused_since: float | None = None
        self._seen: dict[str, Any] = {}
        self._bars = Bars(quiet=quiet)
        self._standstill = Standstill(graph.namespace) if graph.restarts else None
        self._open = contextlib.ExitStack()

    def __enter__(self) -> "Watch":
        with contextlib.ExitStack() as stack:
            if self._standstill:
                stack.enter_context(self._standstill)
            stack.enter_context(self._bars)
            self._open = stack.pop_all()
        self._bars.bar("episodes", 0, self._total or None, "starting")
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def pause_for(self, policy: str, ended: str) -> None:
        """Pause the world until a new process of this policy publishes, since the old one has `ended`."""
        assert self._standstill is not None, "the graph has restarts"
        self._bars.notice(f"{ended}; it is started again, and the world stands still until it is there")
        self._standstill.begin(policy)

    def idle_time(self) -> float:
        """Return for how long nothing has happened [s]."""
        return time.monotonic() - self._last

    def paused_time(self) -> float:
        """Return for how long the world has stood still because of a service call [s]; 0 where it goes on."""
        return 0.0 if self._paused_since is None else time.monotonic() - self._paused_since

    def take(self, statuses: dict[str, NodeStatus]) -> None:
        """Take the nodes' latest reports."""
        if self._standstill:
            self._standstill.spin()
        for node, status in statuses.items():
            paused = status.state == "paused" and not (self._standstill and self._standstill.lasts)
            if node == "world_simulator":
                self._paused_since = (self._paused_since or time.monotonic()) if paused else None
            seen = status.state, status.figures, status.counts
            # The recorder goes on writing diagnostics, its own among them, however long nothing happens.
            if paused or (seen != self._seen.get(node) and node != "recorder"):
                self._last = time.monotonic()
            self._seen[node] = seen
        self._show(statuses)

    def _show(self, statuses: dict[str, NodeStatus]) -> None:
        world, learner = (statuses.get(node, NodeStatus()) for node in ("world_simulator", "learner"))
        ended = world.counts.episodes_ended if world.counts else 0
        done = ended if self._total else int(learner.number("episode") or 0)
        total = self._total or int(learner.number("episodes") or 0) or None
        rate = world.number("ticks_per_second")
        parts = [] if rate is None else [f"{rate:g} ticks/s"]
        learned = {name: learner.number(name) for name in SHOWN}
        parts += [f"{name.replace('_', ' ')} {value:g}" for name, value in learned.items() if value is not None]
        note = ", ".join(part for part in (*parts, failures.waiting(statuses)) if part)
        self._bars.bar("episodes", done, total, note)
        self._bars.line(f"{done} of {total or '?'}; {note}")
