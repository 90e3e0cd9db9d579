"""The real graph: separate processes over Fast DDS. Same episodes as in process, and no end that hangs."""

import errno
import json
import os
import re
import resource
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.nodes.graph import GraphResult, NodeProcesses, resolve, run_graph
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.weights import load_weights
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.run_config import RunConfig, Sections
from vpsci_ros.wire import layout
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.observation import AGENTS

GENERATE = ["world_simulator", "safety_monitor", "vehicle_policy", "pedestrian_policy", "recorder"]
OnceItRecords = Callable[..., None]
forked = pytest.mark.usefixtures("forked_nodes")  # for the rest of the module, so below those that start processes


def sections(weights: str, **world: Any) -> Sections:
    settings = {"seed": 5, "scenarios": [1, 8], "episodes": 3, "batch": 4, "episode_time": 6.0} | world
    return Sections(
        {
            "graph": {"nodes": GENERATE, "progress_timeout": 240.0},
            "world_simulator": settings,
            "vehicle_policy": {"weights": weights},
            "pedestrian_policy": {"weights": weights},
        }
    )


def fewest(chosen: Sections, *policies: str) -> Sections:
    """Leave out of a graph the policies that are not named; whom they would move, the autopilot does."""
    nodes = [node for node in GENERATE if node in policies or not node.endswith("_policy")]
    drivers = {f"{agent}_driver": "autopilot" for agent in AGENTS if f"{agent}_policy" not in policies}
    return chosen.changed("graph", {"nodes": nodes}).changed("world_simulator", drivers)


def recorded_ticks(bag: Path) -> dict[int, dict[str, Any]]:
    """Return what a bag holds, by tick and topic."""
    ticks: dict[int, dict[str, Any]] = {}
    with AnyReader([bag]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic in ("/world/state", "/safety/state", "/vehicle/action", "/pedestrian/action"):
                assert connection.topic not in ticks.setdefault(message.tick, {}), "recorded twice"
                ticks[message.tick][connection.topic] = message
    return ticks


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, weights: str) -> GraphResult:
    """A run to its end; not to be changed."""
    with own_domain():
        chosen = sections(weights, action_timeout=60.0)  # on a busy machine no answer is missing, either
        return run_graph(chosen, tmp_path_factory.mktemp("whole") / "run", quiet=True)


def test_separate_processes_and_one_process_make_the_same_episodes_bit_for_bit(
    whole: GraphResult, weights: str
) -> None:
    assert whole.error == ""
    chosen, recorded = sections(weights), recorded_ticks(whole.bag)

    run, config = chosen.get(RunConfig, "world_simulator"), chosen.get(WorldConfig, "world_simulator")
    world = World(config, load_scenarios(run.scenarios), run.queue(), run.batch, run.seed)
    count = controlled = 0
    for step in Loop(world, agents=policies(load_weights(weights), world)):
        number, state, frame, _ = step.tick
        message = recorded[number]
        for name, values in layout.world_state_fields(state, frame).items():
            got = getattr(message["/world/state"], name)
            assert got.tobytes() == values.tobytes(), f"{name} at tick {number}"
        assert message["/safety/state"].curvttc.tobytes() == step.assessment.curvttc.tobytes()
        assert message["/safety/state"].distance.tobytes() == step.assessment.distance.tobytes()
        for agent in AGENTS:
            if (action := step.actions.of(agent)) is not None:
                assert message[f"/{agent}/action"].longitudinal.tobytes() == action[:, 0].tobytes()
                assert message[f"/{agent}/action"].lateral.tobytes() == action[:, 1].tobytes()
                controlled += int(np.count_nonzero(action))
        count += 1
    assert count == len(recorded)
    assert controlled > 0, "the policies never acted, so nothing was compared"


def test_a_run_tells_what_it_did_and_with_what(whole: GraphResult, weights: str) -> None:
    record = json.loads((whole.folder / "run.json").read_text())
    assert record["error"] == ""
    assert record["results"]["nodes"]["world_simulator"]["counts"]["episodes_ended"] == 6
    assert record["inputs_sha256"] == {weights: sha256(weights)}
    assert set(record["results"]["exit_status"].values()) == {0}
    assert [path.stat().st_mode & 0o777 for path in (whole.bag, whole.folder / "log")] == [0o700, 0o700]
    with AnyReader([whole.bag]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
    assert counts["/world/state"] == counts["/safety/state"] == counts["/clock"]


@pytest.fixture
def once_it_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> OnceItRecords:
    """Return the function that does something to the nodes of the graph in `run` when its bag exceeds `size` bytes."""
    started: list[NodeProcesses] = []
    enter = NodeProcesses.__enter__
    monkeypatch.setattr(NodeProcesses, "__enter__", lambda self: started.append(self) or enter(self))

    def wait(act: Callable[[NodeProcesses], object], size: int) -> None:
        while not any(file.stat().st_size > size for file in (tmp_path / "run" / "bag").glob("*.mcap")):
            time.sleep(0.02)
        act(started[0])

    return lambda act, size=20_000: threading.Thread(target=wait, args=(act, size), daemon=True).start()


def test_stopping_on_request_completes_the_bag_where_interrupts_were_ignored(
    domain: int, tmp_path: Path, weights: str, once_it_records: OnceItRecords
) -> None:
    sent: list[bool] = []
    once_it_records(lambda _: sent.append(os.kill(os.getpid(), signal.SIGINT) is None))

    def goes_on(*_: object) -> str:
        """End a run that has gone on five times since, which may only happen where the request is lost."""
        sent.extend(sent[:1])
        return "goes on" if len(sent) > 5 else ""

    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a background job of a shell inherits it
    try:
        chosen = fewest(sections(weights, episodes=100_000))
        result = run_graph(chosen, tmp_path / "run", quiet=True, stop_when=goes_on)
    finally:
        signal.signal(signal.SIGINT, before)
    assert result.error == "stopped on request"
    assert set(result.exits.values()) == {0}
    assert (result.bag / "metadata.yaml").exists()
    assert len(recorded_ticks(result.bag)) > 5


@forked
@pytest.mark.parametrize("victim", ["world_simulator", "vehicle_policy", "recorder"])
def test_killing_any_process_ends_the_run_with_its_name_and_a_bag_that_opens(
    domain: int, tmp_path: Path, weights: str, victim: str, once_it_records: OnceItRecords
) -> None:
    once_it_records(lambda nodes: os.kill(nodes.running[victim].pid, signal.SIGKILL))
    chosen = sections(weights, episodes=100_000, batch=16)  # far more than can end before the kill
    result = run_graph(fewest(chosen, victim), tmp_path / "run", quiet=True)
    assert f"{victim} was killed by SIGKILL" in result.error
    assert result.exits[victim] == -signal.SIGKILL
    states = sorted(tick for tick, topics in recorded_ticks(result.bag).items() if "/world/state" in topics)
    assert len(states) > 5
    assert states == [*range(states[0], states[-1] + 1)], "what a killed publisher had not sent yet is lost at the end"


@forked
@pytest.mark.parametrize(
    ("victim", "number", "episodes", "missing"),
    [
        ("world_simulator", signal.SIGTERM, 8, r"\b(\d|1[0-5]) of 16 episodes ended"),
        ("vehicle_policy", signal.SIGSTOP, 800, r"^\d\d+ answers of vehicle_policy are missing: the run has failed"),
    ],
)
def test_a_run_in_which_a_node_was_stopped_with_anything_missing_is_no_success(
    domain: int,
    tmp_path: Path,
    weights: str,
    victim: str,
    number: signal.Signals,
    episodes: int,
    missing: str,
    once_it_records: OnceItRecords,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("vpsci_ros.nodes.graph.STOP_STEPS", ((signal.SIGINT, 5.0), (signal.SIGKILL, 30.0)))
    once_it_records(lambda nodes: os.kill(nodes.running[victim].pid, number), 10_000)
    # 16 at once, so that the first chunk of the bag is on disk long before the last tick
    chosen = sections(weights, episodes=episodes, batch=16, episode_time=5.0, real_time_factor=3.0, action_timeout=0.2)
    result = run_graph(fewest(chosen, victim), tmp_path / "run", quiet=True)
    assert re.search(missing, result.error)
    assert json.loads((tmp_path / "run" / "run.json").read_text())["error"] == result.error


@forked
def test_a_full_disk_under_the_recorder_ends_the_run_with_a_reason_and_a_record(
    domain: int, tmp_path: Path, weights: str, once_it_records: OnceItRecords, monkeypatch: pytest.MonkeyPatch
) -> None:
    def repair(bag: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(bag / "bag_0.mcap"))

    def fill(nodes: NodeProcesses) -> None:
        resource.prlimit(nodes.running["recorder"].pid, resource.RLIMIT_FSIZE, (40_000, 40_000))

    monkeypatch.setattr("vpsci_ros.nodes.graph.repair_bag", repair)
    once_it_records(fill)
    chosen = sections(weights, episodes=100_000, batch=16)
    result = run_graph(fewest(chosen), tmp_path / "run", quiet=True)
    assert "recorder ended with exit status 1" in result.error
    assert "the disk refused a part of it (File too large)" in result.error
    assert "bag_0.mcap: No space left on device; free some space" in result.error
    assert json.loads((tmp_path / "run" / "run.json").read_text())["error"] == result.error
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == ["bag", "log", "params.yaml", "run.json"]


def test_a_folder_that_is_not_empty_is_refused_before_anything_starts(tmp_path: Path, weights: str) -> None:
    (tmp_path / "kept").write_text("kept")
    with pytest.raises(InvalidInput, match="not empty"):
        run_graph(sections(weights), tmp_path, quiet=True)
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        (sections("people", batch=0), "world_simulator: batch = 0 is out of range; expected 1 to 65536"),
        (sections("refind"), r"'refind': expected a \.safetensors file or a shipped name"),
    ],
)
def test_a_parameter_out_of_range_and_absent_weights_are_refused_before_anything_starts(
    tmp_path: Path, chosen: Sections, message: str
) -> None:
    with pytest.raises(InvalidInput, match=message):
        run_graph(chosen, tmp_path / "run", quiet=True)
    assert not (tmp_path / "run").exists()


def test_a_graph_without_a_leading_node_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="expected world_simulator or learner among them"):
        resolve(Sections({"graph": {"nodes": ["safety_monitor"]}}), tmp_path)
