"""The learner: stage 1 from real near misses, or stage 2 from `/replay` while the graph runs."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import UInt64

from vpsci_msgs.msg import PolicyWeights, Transition
from vpsci_ros.data.corpus import load_corpus
from vpsci_ros.errors import Stopped
from vpsci_ros.learning.pretrain import CHECKPOINT, pretrain
from vpsci_ros.learning.refine import WEIGHTS, Refiner
from vpsci_ros.learning.refine_log import RefineLog
from vpsci_ros.learning.training_config import LearnerConfig, PretrainConfig, RefineConfig
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.topics import RECORDING
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.wire import layout

REPORT_PERIOD = 0.5  # [s] between diagnostics


class Learner(GraphNode):
    """Stage 1 reads near misses and writes weights. Stage 2 subscribes to `/replay` and publishes `/policy/weights`."""

    drains = True

    def __init__(self, **given: Any) -> None:
        super().__init__("learner", **given)
        self._config = self.config(LearnerConfig)
        self._near_misses = load_corpus(self._config.near_misses)
        self._folder = Path(self._config.output)
        self._figures: dict[str, Any] = {}
        self._reported = 0.0
        self._preparations = 0  # of stage 1, before its first iteration
        self._refiner: Refiner | None = None
        self._whole, self._announced = True, False
        if self._config.stage == "pretrain":
            self.wall_timer(0.01, self._pretrain)
        else:
            self._refiner = self._begin_refining()

    @property
    def state(self) -> str:
        """The learner's stage, "pretrain" or "refine"."""
        return self._config.stage

    def figures(self) -> dict[str, Any]:
        """Return the latest values of the training's progress, by name."""
        return self._figures

    def _pretrain(self) -> None:
        try:
            pretrain(
                self._near_misses,
                self.config(PretrainConfig),
                self.config(NetworkConfig),
                seed=self._config.seed,
                out_dir=self._folder,
                report=self._report_pretraining,
                beginning=self._beginning,
            )
        except Stopped:
            kept = (
                f"`vpsci pretrain` with the same parameters and -o {self._folder} goes on from its checkpoint"
                if (self._folder / CHECKPOINT).exists()
                else "before the first iteration, so there is nothing to keep"
            )
            self.get_logger().info(f"stopped; {kept}")
        self._report({}, last=True)
        self.finished = True

    @contextmanager
    def _beginning(self) -> Iterator[None]:
        """Report a long preparation, for which a recorder has to be there; a stop request ends it at once."""
        self._preparations += 1
        self._report({"preparations": self._preparations}, last=True)
        with self.stop.at_once():
            yield

    def _report_pretraining(self, progress: dict[str, float]) -> None:
        self._report(progress)
        self.stop.check()

    def _begin_refining(self) -> Refiner:
        weights = load_weights(self._config.start())
        config = self.config(RefineConfig)
        refiner = Refiner(config, weights, self._near_misses, seed=self._config.seed, out_dir=self._folder)
        self._log = RefineLog(refiner, self._folder)
        self._weights = self.output("/policy/weights")
        self._consumed = self.output("/replay/consumed")
        self.input("/replay", self._transitions, partial(self._on_transitions, refiner), RECORDING)
        self._first = self.wall_timer(0.01, partial(self._publish_first, refiner))
        return refiner

    def _publish_first(self, refiner: Refiner) -> None:
        self._first.cancel()
        self._publish_weights(refiner)

    def _transitions(self, message: Transition) -> NDArray[np.void]:
        self.simulated_at = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        return layout.transitions(message)

    def _on_transitions(self, refiner: Refiner, rows: NDArray[np.void]) -> None:
        refused = refiner.assembler.refused
        refiner.add(rows)
        if (now := refiner.assembler.refused) > refused:
            self.get_logger().warning(
                f"refused {now - refused} transitions, {now} so far: expected finite numbers,"
                f" a CurvTTC that is not negative and policies that act at step 0;"
                f" does another program publish {self.full_name('/replay')}?",
                throttle_duration_sec=5.0,
            )
        while refiner.due and not refiner.finished and not self.stop.is_set():
            self._whole = False
            refiner.update()
            self._whole = True
            self._report(refiner.summary())
        if refiner.finished and not self._announced:
            self._announced = True
            self.get_logger().info("converged by the test of section 4.1; no further updates")
        if refiner.take_refresh():
            self._publish_weights(refiner)
        self._consumed.publish(UInt64(data=refiner.assembler.consumed))
        self._report(refiner.summary())
        self._log.note()

    def _publish_weights(self, refiner: Refiner) -> None:
        message = PolicyWeights(version=refiner.progress.version)
        message.header.stamp = self.simulated_time
        message.safetensors.frombytes(refiner.weights())
        self._weights.publish(message)

    def _report(self, values: dict[str, float], last: bool = False) -> None:
        """Store these figures and, at most once in `REPORT_PERIOD` or if `last`, publish the latest of every name."""
        for name, value in values.items():
            self._figures[name] = f"{value:.4g}" if isinstance(value, float) else value
        now = time.monotonic()
        if now - self._reported > REPORT_PERIOD or last:
            self._reported = now
            if not self._refiner:  # stage 1 knows no simulated time
                self.simulated_at = self.get_clock().now().nanoseconds
            self.report(wait=last)

    def close(self) -> None:
        """Write, in stage 2, the last rows of the log and, unless an update failed, the refined weights."""
        if self._refiner is not None:
            self._log.note(last=True)
            if self._whole:
                self._refiner.save()
                self.get_logger().info(f"wrote {self._folder / WEIGHTS}")
            self._report(self._refiner.summary(), last=True)
