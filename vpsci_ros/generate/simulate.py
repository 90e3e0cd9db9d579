"""Episodes by their numbers: world, monitor, policies and filters over one unit of work, in one thread.

Every episode is simulated to its end. Episodes that are never critical could end early, but they run without policies
and cost about a tenth of the time, and to end them needs a proof that CurvTTC stays high in any scenario file.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode_block import EpisodeBlock, EpisodeFrames, concat_blocks
from vpsci_ros.data.filters import FilterConfig, apply_filters
from vpsci_ros.errors import VpsciError
from vpsci_ros.generate.job import Job, Unit
from vpsci_ros.generate.parts import Parts
from vpsci_ros.policy.agent import PolicyAgent, learned_agent
from vpsci_ros.policy.onset_range import onsets_in, ranges
from vpsci_ros.policy.policy_file import policy_from_bytes
from vpsci_ros.runs.workers import Place
from vpsci_ros.world import World
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.tick import Step

Floats = NDArray[np.float64]
TOGETHER = 64  # ended episodes that wait until they are filtered together


class Simulator:
    """Computes units of a job; the episodes' bits depend neither on `batch` nor on earlier units.

    :param batch: parallel episodes.
    """

    def __init__(self, job: Job, batch: int) -> None:
        self._job = job
        self._batch = batch
        self._agents: dict[str, PolicyAgent] = {}
        for agent, policy in job.policies.items():
            self._agents[agent] = learned_agent(agent, policy.config)
            self._agents[agent].load(policy_from_bytes(policy.data, policy.name), version=1)

    def loop(self, episodes: Iterable[tuple[int, int]], scenario: int = 0) -> Loop:
        """Return the loop over these episodes' ticks, (scenario, number) each; `scenario`: load it alone, 0: all."""
        scenarios = [own for own in self._job.scenarios if own.number == scenario] or self._job.scenarios
        world = World(self._job.world, scenarios, episodes, self._batch, self._job.seed)
        return Loop(world, self._agents)

    def __call__(self, unit: Unit) -> EpisodeBlock:
        """Simulate the unit's episodes and apply the filters to them."""
        job, loop = self._job, self.loop(((unit.scenario, number) for number in unit.numbers), unit.scenario)
        whole = collected(loop, loop.ticks(), job.filters, job.keep_rejected)
        if not np.array_equal(whole.records["count"], unit.numbers):
            raise VpsciError(f"scenario {unit.scenario}: {len(unit.numbers)} episodes were due, {len(whole)} ended")
        return whole


def collected(
    loop: Loop,
    ticks: Iterable[Step],
    filters: FilterConfig,
    keep_rejected: bool,
    report: Callable[[int], None] | None = None,
) -> EpisodeBlock:
    """Return the episodes that end in a loop's ticks, filtered, in the order of their scenarios and numbers.

    :param ticks: of the loop, to the end of its queue.
    :param keep_rejected: keep the frames of rejected episodes.
    :param report: called with the number of episodes that have ended.
    """
    world = loop.world
    frames = EpisodeFrames(len(world.state), world.config.episode_ticks + 1, TOGETHER, scenarios=world.scenarios)
    reaches = [agent.reach for agent in loop.agents.values() if isinstance(agent, PolicyAgent)]
    blocks, ended = [], 0
    for step in ticks:
        if frames.store(step) >= TOGETHER or world.done:
            block = apply_filters(frames.take(), filters)
            blocks.append(ranged(block, [own for own in reaches if own is not None]).stored(keep_rejected))
            ended += len(block)
            if report is not None:
                report(ended)
    return replace(concat_blocks(blocks), period=world.config.tick, scenarios=world.scenarios)


def ranged(block: EpisodeBlock, reaches: Sequence[Floats]) -> EpisodeBlock:
    """Return episodes with their `range`: whether they become critical within the recorded range.

    :param block: whose rows are all there.
    :param reaches: float64[4, 5] of each agent that acts by a bank, see `vpsci_ros.policy.onset_range`.
    """
    records, (episode, row) = block.records.copy(), block.first_critical()
    vehicle, velocity, place, walk = np.split(block.values[row, :8], 4, axis=1)
    np.maximum.at(records["range"], episode, ranges(onsets_in(vehicle, velocity, place, walk), reaches))
    return EpisodeBlock(records, block.values)


def storing(job: Job, batch: int, parts: Parts, place: Place) -> Callable[[Unit], int]:
    """Return a function that computes a unit, writes its part at a place, and returns the number of kept episodes."""
    job.compile_kernels()  # on a machine where that has not been done
    simulator, here = Simulator(job, batch), parts.at(place.folder)

    def store(unit: Unit) -> int:
        block = simulator(unit)
        here.write(unit, block)
        return int(np.count_nonzero(block.kept))

    return store
