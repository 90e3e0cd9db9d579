"""Watching a run of a graph: the time without progress, and its progress on standard error."""

import time
from typing import Any

from vpsci_ros.nodes import failures
from vpsci_ros.nodes.status import NodeStatus
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.run_config import RunConfig, Sections

SHOWN = ("updates", "refreshes", "closed_loop_ade", "held_out_closed_loop_ade")


class Watch:
    """Takes the nodes' reports and shows progress; use it in a `with` block.

    :param resolved: parameters of the graph.
    :param quiet: show nothing.
    """

    def __init__(self, resolved: Sections, *, quiet: bool = False) -> None:
        self._world = "world_simulator" in resolved.values
        learner = resolved.values.get("learner", {})
        self._total = resolved.get(RunConfig, "world_simulator").total if self._world else learner.get("episodes", 0)
        self._last = time.monotonic()
        self._excused = 0.0  # [s] of the time since
        self._seen: dict[str, Any] = {}
        self._bars = Bars(quiet=quiet)

    def __enter__(self) -> "Watch":
        self._bars.__enter__()
        self._bars.bar("episodes", 0, self._total or None, "starting")
        return self

    def __exit__(self, *given: Any) -> None:
        self._bars.__exit__(*given)

    def idle_time(self) -> float:
        """Return the time without progress [s], minus the excused time; a world paused by a service is not idle."""
        return time.monotonic() - self._last - self._excused

    def excuse(self, seconds: float) -> None:
        """Subtract from the idle time `seconds` in which a node could not run or was still starting."""
        self._excused += seconds

    def take(self, statuses: dict[str, NodeStatus]) -> None:
        """Show the progress in the nodes' latest reports; restart the idle time if a node progressed or is paused."""
        for node, status in statuses.items():
            seen = status.state, status.figures, status.counts
            # The recorder goes on writing diagnostics, its own among them, however long nothing happens.
            if status.state == "paused" or (seen != self._seen.get(node) and node != "recorder"):
                self._last, self._excused = time.monotonic(), 0.0
            self._seen[node] = seen
        self._show(statuses)

    def _show(self, statuses: dict[str, NodeStatus]) -> None:
        world, learner = (statuses.get(node, NodeStatus()) for node in ("world_simulator", "learner"))
        ended = world.counts.episodes_ended if world.counts else 0
        done = ended if self._world else int(learner.number("episode") or 0)
        rate = world.number("ticks_per_second")
        parts = [] if rate is None else [f"{rate:g} ticks/s"]
        learned = {name: learner.number(name) for name in SHOWN}
        parts += [f"{name.replace('_', ' ')} {value:g}" for name, value in learned.items() if value is not None]
        note = ", ".join(part for part in (*parts, failures.waiting(statuses)) if part)
        self._bars.bar("episodes", done, self._total or None, note)
        self._bars.line(f"{done} of {self._total or '?'} episodes" + f"; {note}" * bool(note))
