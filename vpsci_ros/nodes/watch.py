"""Watching a run from outside: counts ended episodes, reads the nodes' diagnostics, and shows progress."""

import math
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool

from vpsci_msgs.msg import EpisodeEvent
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.config import NODES, GraphConfig
from vpsci_ros.nodes.intake import SECOND
from vpsci_ros.nodes.middleware import set_defaults
from vpsci_ros.nodes.topics import RECORDING
from vpsci_ros.runs.config import RunConfig
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.sections import Sections
from vpsci_ros.wire import received

WATCH = "graph_watch"  # the listener's name in the table of topics
DRAIN_QUIET = 0.2  # [s]
WORTH_SHOWING = ("updates", "refreshes", "rollbacks", "closed_loop_ade", "held_out_closed_loop_ade")


class Watch:
    """A listener on `/episode/event` and `/diagnostics` with a progress bar; use it in a `with` block.

    :param resolved: parameters of the graph.
    :param quiet: count, but show nothing.
    """

    def __init__(self, resolved: Sections, *, quiet: bool = False) -> None:
        self._namespace = resolved.get(GraphConfig, "graph").namespace
        self._held: dict[str, set[bytes]] = {}  # policies that are awaited, and whoever spoke in their place before
        self._run = resolved.get(RunConfig, "world_simulator") if "world_simulator" in resolved.values else None
        self._total = self._run.total if self._run else 0
        self._ended: set[tuple[int, int]] = set()
        self._refused = 0
        self._last = time.monotonic()
        self._paused_since: float | None = None
        self._status: dict[str, dict[str, str]] = {}
        self._bars = Bars(quiet=quiet)

    def __enter__(self) -> "Watch":
        set_defaults()
        self._context = Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(WATCH, context=self._context, namespace=self._namespace or None)
        self._pause = self._node.create_client(SetBool, "world/pause")
        self._node.create_subscription(EpisodeEvent, "episode/event", self._on_event, RECORDING)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, RECORDING)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._bars.__enter__()
        self._bars.bar("episodes", 0, self._total or None, "starting")
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.__exit__()
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def spin(self, seconds: float) -> None:
        """Handle what arrives within `seconds` and bring the display up to date."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)
        for policy in [name for name, before in self._held.items() if self._speakers(name) - before]:
            del self._held[policy]
            if not self._held:
                self._pause.call_async(SetBool.Request(data=False))
        self._show()

    def hold(self, policy: str) -> None:
        """Have the world stand still until another process of this policy is there."""
        self._held[policy] = self._speakers(policy)
        self._pause.call_async(SetBool.Request(data=True))

    def _speakers(self, policy: str) -> set[bytes]:
        topic = self._node.resolve_topic_name(f"{policy.removesuffix('_policy')}/action")
        return {bytes(writer.endpoint_gid) for writer in self._node.get_publishers_info_by_topic(topic)}

    def drain(self) -> None:
        """Handle what is still on its way at the end of the run."""
        while self.idle_time() < DRAIN_QUIET:
            self._executor.spin_once(timeout_sec=DRAIN_QUIET)
        self._show()

    def idle_time(self) -> float:
        """Return for how long nothing has happened [s]."""
        return time.monotonic() - self._last

    def paused_time(self) -> float:
        """Return for how long somebody has had the world stand still [s]; 0 where it goes on."""
        return 0.0 if self._paused_since is None else time.monotonic() - self._paused_since

    def summary(self) -> dict[str, float]:
        """Return the numbers seen last: episodes ended, and each node's diagnostics as "node.key"."""
        numbers = {f"{node}.{key}": value for node, pairs in self._status.items() for key, value in pairs.items()}
        own = {"episodes_ended": float(len(self._ended)), "events_refused": float(self._refused)}
        return own | {k: float(v) for k, v in numbers.items() if _is_number(v)}

    def second_publishers(self) -> list[str]:
        """Return who else than the graph's nodes was seen to publish on which topic."""
        named = (pairs.get(SECOND, "") for pairs in self._status.values())
        return sorted({each for text in named for each in text.split(", ") if each})

    def _on_event(self, message: EpisodeEvent) -> None:
        self._last = time.monotonic()
        try:
            events = received.events(message)
        except InvalidInput:
            self._refused += 1
            return
        ended = events[events["kind"] == EpisodeEvent.ENDED]
        keys = zip(ended["scenario"].tolist(), ended["episode"].tolist(), strict=True)
        self._ended |= {key for key in keys if self._run and self._run.asks_for(*key)}

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        prefix = f"{self._namespace.strip('/')}/" if self._namespace else ""
        for status in (each for each in message.status if each.name in {f"{prefix}{node}" for node in NODES}):
            name = status.name.removeprefix(prefix)
            pairs = {pair.key: pair.value for pair in status.values}
            stands_still = status.message == "paused" and not self._held  # as somebody has asked for
            if status.name == "world_simulator":
                self._paused_since = (self._paused_since or time.monotonic()) if stands_still else None
            # The recorder writes diagnostics down as well, its own among them, however long nothing happens.
            moves_on = pairs != self._status.get(name) and name != "recorder"
            if stands_still or moves_on:
                self._last = time.monotonic()
            self._status[name] = pairs

    def _show(self) -> None:
        told = self.summary()
        done = len(self._ended) if self._total else int(told.get("learner.episode", 0))
        total = self._total or int(told.get("learner.episodes", 0)) or None
        rate = told.get("world_simulator.ticks_per_second")
        parts = [] if rate is None else [f"{rate:g} ticks/s"]
        learned = {key: told.get(f"learner.{key}") for key in WORTH_SHOWING}
        parts += [f"{key.replace('_', ' ')} {value:g}" for key, value in learned.items() if value is not None]
        note = ", ".join(parts)
        self._bars.bar("episodes", done, total, note)
        self._bars.line(f"{done} of {total or '?'}; {note}")


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
