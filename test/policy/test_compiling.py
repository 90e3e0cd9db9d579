"""What is compiled beforehand is what episodes with policies run, and a part that fails is named."""

import json
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from vpsci_ros.policy import compiling
from vpsci_ros.policy.policy_file import load_policy

EPISODES = """
import json, sys
from vpsci_ros.data.episode_block import EpisodeFrames
from vpsci_ros.data.filters import FilterConfig, apply_filters
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.compiling import PARTS
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.safety.compiled import Kernel
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop

def called():
    modules = [module for module in list(sys.modules.values()) if module.__name__.startswith("vpsci_ros.")]
    found = {
        f"{module.__name__}.{name}": value
        for module in modules for name, value in vars(module).items() if isinstance(value, Kernel)
    }
    return sorted(f"{name} {signature}" for name, value in found.items() for signature in value.from_python.signatures)

for part in PARTS.values():
    part()
beforehand, ticks = called(), 0
for policy in ("people", "closed_loop"):
    world = World(WorldConfig(), load_scenarios([1]), [(1, number) for number in range(4)], 4, 0)
    loop, frames = Loop(world, agents=policies(load_policy(policy), world)), EpisodeFrames(4, 601)
    for step in loop:
        frames.store(step)
        ticks += step.actions.vehicle is not None and step.actions.vehicle.any()
    apply_filters(frames.take(), FilterConfig())
print(json.dumps([beforehand, called(), int(ticks)]))
"""


def test_episodes_with_policies_call_no_kernel_that_was_not_compiled_beforehand():
    result = subprocess.run([sys.executable, "-c", EPISODES], capture_output=True, text=True, check=True, timeout=300)
    beforehand, afterwards, ticks = json.loads(result.stdout.splitlines()[-1])
    assert ticks > 0, "the policies act"
    later = {kernel for kernel in afterwards if ".tick._all_finite " not in kernel} - set(beforehand)
    assert later == set()  # but for `_all_finite`: a fifth of a second
    for name in ("engine.move_one", "choice.act", "streaming_kernels.step_slots"):
        assert any(f".{name} " in kernel for kernel in beforehand)


def test_what_the_policies_need_is_compiled_once_and_a_part_that_fails_is_named_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiling, "PARTS", {"no such part": lambda: None})
    monkeypatch.setattr(compiling, "SIDE_BY_SIDE", [["no such part"]])
    for _ in range(2):
        compiling.compile_kernels()
    assert capfd.readouterr().err.count("no such part ended with 1: KeyError: 'no such part'") == 2
    monkeypatch.setattr(compiling, "PARTS", dict.fromkeys(("spawn", "people", "network"), lambda: None))
    monkeypatch.setattr(compiling, "SIDE_BY_SIDE", [["spawn", "people"], ["network"]])
    started = partial(subprocess.Popen, ["true"], stderr=subprocess.PIPE, text=True)
    monkeypatch.setattr(compiling.subprocess, "Popen", lambda *_, **__: started())
    networks = load_policy("closed_loop")
    for policies in ((), (), (networks,), (networks,)):
        compiling.compile_kernels(*policies)
    said = capfd.readouterr().err.splitlines()
    assert [line.partition(": ")[2] for line in said] == ["spawn, people", "network"]
