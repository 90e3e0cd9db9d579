"""A policy of Stable-Baselines3 drives through the node as it does in the environment, and its class sits the exam."""

import sys
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rclpy
from class_in_process import class_in_process
from composed import composed

pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (extra: baselines)")
pytest.importorskip("gymnasium", reason="needs gymnasium (extra: rl)")

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.envs.right_turn import RightTurnEnv
from vpsci_ros.exam.exam import prepare
from vpsci_ros.exam.result import Conduct, read_result
from vpsci_ros.exam.run import run_with
from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.nodes.graph import resolve
from vpsci_ros.resources import params_dir
from vpsci_ros.world import WorldConfig

PROGRAM = Path(__file__).parents[2] / "examples" / "trained_policy.py"


@pytest.fixture(scope="module")
def example(tool: Callable[..., ModuleType]) -> ModuleType:
    return tool("trained_policy", "examples")


@pytest.fixture(scope="module")
def weights(example: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy that has learned for a moment: it moves, and needs to do no more."""
    path = tmp_path_factory.mktemp("trained") / "out" / "policy.safetensors"
    command = [str(PROGRAM), "train", str(path), "--steps", "512", "--scenarios", "1", "101"]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sys, "argv", command)
        patched.setattr(example, "ENVIRONMENTS", 2)
        example.main()
    return path


def test_the_node_does_what_the_policy_does_in_the_environment(
    example: ModuleType, weights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy = example.load(weights)
    monkeypatch.setenv("TRAINED_POLICY", str(weights))
    env = RightTurnEnv([101], pedestrian="autopilot", config=WorldConfig(pedestrians=3))
    most_critical: set[tuple[int, int]] = set()  # seed, and which pedestrian it was
    for seed in range(4, 40):
        observation, _ = env.reset(seed=seed)
        by_class, driver = example.PolicyDriver(), example.Driver(policy)
        by_class.reset(None)
        for _ in range(20):
            action, _ = policy.predict(observation, deterministic=True)
            expected = example.task.controls(action[None])[0]
            seen = SimpleNamespace(of_environment=partial(np.copy, observation))
            for _ in range(example.HOLD):
                np.testing.assert_allclose(by_class.act(seen), expected, atol=1e-6)
                seen = SimpleNamespace(of_environment=partial(np.zeros, 21))  # at which it holds its action
            state: Any = env._one._simulation.world.state.copy()
            most_critical.add((seed, int(env._one._last.state["pedestrian"][0])))
            state["table"], state["route_s"] = 0, 0.0  # which no message tells
            np.testing.assert_allclose(driver.control(state), expected, atol=1e-5)
            observation, _, ended, cut, _ = env.step(action)
            if ended or cut:
                break
        if any(who > 0 for _, who in most_critical):
            break
    assert {who > 0 for _, who in most_critical} == {False, True}, "not always the same pedestrian"


def test_through_the_graph_it_answers_every_tick(
    example: ModuleType, weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = {"scenarios": [101], "episodes": 2, "episode_time": 4.0, "action_timeout": 30.0, "batch": 1}
    world |= {"vehicle_driver": "external", "pedestrian_driver": "autopilot"}
    chosen = load(params_dir() / "ads_test.yaml").changed("world_simulator", world)
    chosen = chosen.changed("graph", {"nodes": ["world_simulator", "safety_monitor"]})
    monkeypatch.setattr(sys, "argv", [str(PROGRAM), "drive", str(weights)])
    drives = threading.Thread(target=example.main, daemon=True)
    with own_domain():
        drives.start()
        with composed(resolve(chosen, tmp_path)) as made:
            counts = made["world_simulator"].counts
        rclpy.shutdown()
    drives.join(60.0)
    assert not drives.is_alive()
    assert counts is not None
    assert counts.episodes_ended == 2
    assert (counts.vehicle_answers_missing, counts.vehicle_commands_refused) == (0, 0)


def test_its_class_sits_the_exam(weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(PROGRAM.parent)
    monkeypatch.setenv("TRAINED_POLICY", str(weights))
    exam = {"pedestrians": ["walker"], "baseline": False}
    world = {"scenarios": [101], "episodes": 2, "episode_time": 4.0}
    chosen = load(params_dir() / "ads_test.yaml").changed("world_simulator", world).changed("ads_test", exam)
    with class_in_process():
        run_with(prepare(chosen, ads_class="trained_policy:PolicyDriver"), "walker", tmp_path)
    found = read_result(tmp_path, "walker")
    assert [episode.name for episode in found.episodes] == ["101:0", "101:1"]
    assert found.conduct == Conduct(wanted=2)
