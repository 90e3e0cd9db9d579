"""A run that lacked an answer: it is counted and recorded, whether or not the answer would have changed anything."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from composed import composed
from nodes.stage import PATIENCE

from vpsci_ros.bags.ticks import read_bag
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.lockstep.lock_step import LockStep
from vpsci_ros.nodes.agent_policy import AgentPolicy
from vpsci_ros.nodes.failures import incomplete
from vpsci_ros.nodes.graph import resolve
from vpsci_ros.runs.run_config import Sections

NODES = ["world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "recorder"]
POLICY = {"weights": "people"}
WORLD = {"scenarios": [3], "episodes": 2, "batch": 2, "episode_time": 1.0, "action_timeout": PATIENCE}
SILENT = 4  # tick


@pytest.mark.usefixtures("domain")
def test_a_missing_answer_is_counted_once_and_the_bag_tells_of_it_where_no_policy_acts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    act = AgentPolicy._act

    def silent(node: AgentPolicy, header: Any, tick: Any, safety: Any) -> bytes | None:
        message = act(node, header, tick, safety)
        return None if node.get_name() == "vehicle_policy" and tick.number == SILENT else message

    may_advance = LockStep.may_advance

    def impatient(lock_step: LockStep, now: float | None = None) -> bool:
        lacks_it_alone = lock_step.unanswered == {"vehicle"} and lock_step.tick.number == SILENT
        return may_advance(lock_step, math.inf if lacks_it_alone else now)

    monkeypatch.setattr(AgentPolicy, "_act", silent)
    monkeypatch.setattr(LockStep, "may_advance", impatient)  # so that no other answer is late on a slow machine
    sections = Sections(
        {"graph": {"nodes": NODES}, "world_simulator": WORLD, "vehicle_policy": POLICY, "pedestrian_policy": POLICY}
    )
    with composed(resolve(sections, tmp_path)) as nodes:
        statuses = {name: node.status() for name, node in nodes.items()}
    (tick,) = (tick for tick in read_bag(tmp_path / "bag") if tick.number == SILENT)
    assert np.count_nonzero(tick.state["status"]) == 2, "two episodes run"
    assert not tick.state["controlled"].any()
    assert incomplete(2, NODES, statuses, None) == ["1 answer of vehicle_policy is missing"]
    verified = verify_bag(tmp_path / "bag")
    assert (verified.difference, verified.uncompared) == ("", ())
