"""`vpsci_ros.simulate`: episodes by one call, in this process; no file is written."""

import difflib
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from vpsci_ros.data.episode_block import EpisodeBlock
from vpsci_ros.data.filters import FilterConfig
from vpsci_ros.documents import shown
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.exam.drivers import Answer, Cockpit, DrivenLoop, Scene
from vpsci_ros.exam.exam import DRIVERS, added_pedestrians
from vpsci_ros.generate.simulate import collected
from vpsci_ros.parameters import build, flat, refuse_unknown
from vpsci_ros.policy.agent import learned_agent
from vpsci_ros.policy.agent_types import make_agent
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.compiling import compile_kernels
from vpsci_ros.policy.policy_config import LEARNED, PolicyConfig
from vpsci_ros.policy.policy_file import SHIPPED, Policy, load_policy
from vpsci_ros.policy.weights import Weights
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.run_config import RunConfig
from vpsci_ros.world import Scenario, World, WorldConfig, load_scenario
from vpsci_ros.world.loop import Agent, Loop
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.tick import Step

SIDE_BY_SIDE = 512  # episodes
SHOWN_AFTER = 2.0  # [s] of work, the progress
RULES = {
    "vehicle": {"autopilot": "autopilot"},
    "pedestrian": {"autopilot": "autopilot"} | {k: v for k, v in DRIVERS.items() if v not in ("policy", "replay")},
}
"""Agent -> name -> its driver in the world, of those that act by rules."""
Named = int | str | Path | Scenario
Chosen = str | Path | Policy | PolicyConfig | type


def simulate(
    scenarios: Named | Sequence[Named],
    agents: Chosen | Mapping[str, Chosen] = "people",
    episodes: int = 10,
    *,
    seed: int = 1,
    first_episode: int = 0,
    quiet: bool = False,
    **world: Any,
) -> EpisodeBlock:
    """Simulate episodes in this process and return all of them, with their frames as float32.

    The episodes are bit-identical to those that `vpsci generate` simulates with the same seed, before it leaves out
    those that its filters reject; `block.kept` says which pass. Progress is shown after two seconds.

    :param scenarios: one or several, each a number, a name, a YAML file or a `Scenario`.
    :param agents: of both agents, or by "vehicle" and "pedestrian"; one that is left out is `people`. An agent is
        "people", "closed_loop", "ma_sst_ddpg", a file of weights or a bank, a `PolicyConfig` (with its seed and
        source), or "autopilot", the rule-based pair. A pedestrian may be "walker" (that of the pair),
        "constant_velocity" or "social_force", or an added agent; a vehicle the class of a driving system
        (docs/driving_systems.md).
    :param episodes: number in each scenario, from `first_episode` on.
    :param seed: of spawns and kinds, from 0 to 2^63 - 1; policies draw by the seed of their `PolicyConfig`.
    :param world: parameters of the world (docs/parameters.md), such as `spawn="paper"`, `pedestrians=2`,
        `kinds={"child": 0.5}`.
    :raises InvalidInput: an unknown scenario, agent or parameter, or a value that is refused.
    :raises VpsciError: the driving system's class raises, or answers with something that is no command.
    """
    where = "simulate"
    several = [scenarios] if isinstance(scenarios, (int, str, Path, Scenario)) else scenarios
    if not isinstance(several, Iterable) or not (several := list(several)):
        raise InvalidInput(f"{where}: scenarios: expected a number, a name, a file or a list, got {shown(scenarios)}")
    roads = [each if isinstance(each, Scenario) else load_scenario(each) for each in several]
    given: dict[str, Any] = {"seed": seed, "episodes": episodes, "first_episode": first_episode}
    whole = {name: int(value) if isinstance(value, np.integer) else value for name, value in given.items()}
    run = build(RunConfig, whole, where)
    chosen = dict(agents) if isinstance(agents, Mapping) else dict.fromkeys(AGENTS, agents)
    refuse_unknown(chosen, dict.fromkeys(AGENTS), f"{where}: agents")
    if taken := [f"{name}_driver" for name in AGENTS if f"{name}_driver" in world]:
        raise InvalidInput(f"{where}: {taken[0]}: leave it out; the argument agents says who drives")
    found = {name: _agent(name, chosen.get(name, "people"), f"{where}: agents: {name}") for name in AGENTS}
    config = build(WorldConfig, flat(world) | {f"{name}_driver": driver for name, (driver, _) in found.items()}, where)
    numbers = range(run.first_episode, run.first_episode + run.episodes)
    queue = [(road.number, number) for number in numbers for road in roads]
    made: dict[str, Agent] = {name: make() for name, (driver, make) in found.items() if driver == "policy"}
    loop = Loop(World(config, roads, queue, min(SIDE_BY_SIDE, len(queue)), run.seed), made)
    ticks = _driven(loop, found["vehicle"][1]) if config.vehicle_driver == "external" else loop.ticks()
    begun = time.monotonic()
    with ExitStack() as stack:
        bars = cache(lambda: stack.enter_context(Bars("episodes", quiet=quiet)))

        def report(ended: int) -> None:
            if time.monotonic() - begun > SHOWN_AFTER:
                bars().bar("episodes", ended, len(queue))
                bars().line(f"{ended:,} of {len(queue):,} episodes", now=ended == len(queue))

        return collected(loop, ticks, FilterConfig(), True, report)


def _agent(name: str, chosen: Any, where: str) -> tuple[str, Callable[[], Any]]:
    """Return an agent's driver in the world, and what makes it.

    :raises InvalidInput: there is no such agent.
    """
    if isinstance(chosen, type):
        missing = [method for method in ("reset", "act") if not callable(getattr(chosen, method, None))]
        if name != "vehicle" or missing:
            raise InvalidInput(
                f"{where}: {chosen.__name__}: a class drives the vehicle and has reset(begin) and act(observation)"
            )
        return "external", chosen
    if isinstance(chosen, (Bank, Weights)):
        return "policy", partial(_loaded, name, PolicyConfig(), chosen)
    if not isinstance(chosen, (str, Path, PolicyConfig)):
        raise InvalidInput(f"{where}: expected a name, a file, a policy or a class, got {shown(chosen)}")
    if str(chosen) in RULES[name]:
        return RULES[name][str(chosen)], lambda: None
    named: dict[str, Any] = {"agent" if chosen in added_pedestrians() else "weights": str(chosen)}
    config = chosen if isinstance(chosen, PolicyConfig) else PolicyConfig(**named)
    if config.agent != LEARNED:
        return "policy", partial(make_agent, name, config)
    if config.weights not in SHIPPED and not config.weights.endswith(".safetensors"):
        known = [*SHIPPED, *RULES[name], *added_pedestrians()]
        near = difflib.get_close_matches(config.weights, known, 1)
        hint = f"did you mean {near[0]}?" if near else f"expected {', '.join(known)}, or a .safetensors file"
        raise InvalidInput(f"{where}: unknown agent {shown(config.weights)}; {hint}")
    return "policy", partial(_loaded, name, config, load_policy(config.weights))


def _loaded(name: str, config: PolicyConfig, policy: Policy) -> Agent:
    compile_kernels(policy)
    agent = learned_agent(name, config)
    agent.load(policy, version=1)
    return agent


def _driven(loop: Loop, make: Callable[[], Any]) -> Iterator[Step]:
    """Yield a loop's ticks, in which objects of a class drive the cars."""
    config = loop.world.config
    cockpit = Cockpit(make, loop.world.scenarios, len(loop.world.state) // config.pedestrians, config.spawn)
    what = getattr(make, "__name__", "the driving system")

    def answers(scenes: Sequence[Scene]) -> Iterable[Answer]:
        for scene, answer in zip(scenes, cockpit.answers(scenes), strict=True):
            if answer.error:
                when = f"{scene.key[0]}:{scene.key[1]} at {scene.observation.time:.2f} s"
                raise VpsciError(f"{what} did not drive {when}: {answer.error}\n{answer.trace}".rstrip())
            yield answer

    driven = DrivenLoop(loop, answers, None, Path(os.devnull))
    yield from driven.ticks(lambda _: None)
    if driven.lost:
        raise VpsciError(driven.failure())
