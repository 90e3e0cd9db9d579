"""A batch of episodes with world, monitor and default pedestrian, advanced by the environment's actions."""

import dataclasses
import operator
import secrets
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.documents import shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.agent import PolicyAgent
from vpsci_ros.policy.agent_types import AGENT_TYPES, make_agent
from vpsci_ros.policy.policy_config import LEARNED, PolicyConfig
from vpsci_ros.policy.policy_file import Policy, load_policy
from vpsci_ros.world import IDLE, OUTCOME_NAMES, World, WorldConfig, load_scenarios
from vpsci_ros.world.drivers import PEDESTRIAN_DRIVERS
from vpsci_ros.world.loop import Agent, Loop
from vpsci_ros.world.tick import NO_ACTIONS, Actions

Floats = NDArray[np.float64]
_NONE = -1  # for a slot that has no seed yet
PEDESTRIANS = tuple(driver for driver in PEDESTRIAN_DRIVERS if driver != "replay")


@dataclasses.dataclass(frozen=True)
class Snapshot:
    """State of each slot's episode after a step, or at the frame at which it ended within the step.

    Of several pedestrians, a slot shows the one with the least CurvTTC, the first of equal ones.

    :ivar state: EPISODE[B]; `status` ENDED where the world ended the episode within the step.
    :ivar curvttc: float64[B] [s], infinity without a contact.
    """

    state: NDArray[np.void]
    curvttc: Floats

    def info(self) -> dict[str, Any]:
        """Return the environment's `info` about the first slot."""
        record = self.state[0]
        return {
            "scenario": int(record["scenario"]),
            "episode_number": int(record["episode"]),
            "outcome": OUTCOME_NAMES[record["outcome"]],
            "curvttc": float(self.curvttc[0]),
            "pedestrian_controlled": bool(record["controlled"]),
        }


class Simulation:
    """`batch` slots, each with its own episode, advanced by the policy period at each step.

    There is one action a slot: the vehicle's, or that of all its pedestrians.

    :param scenarios: numbers, names or files, taken in turn by each slot's episodes.
    :param pedestrian: "policy" (needs `weights`), or a reference pedestrian: "autopilot", "constant_velocity",
        "social_force"; "external" to give its actions to `step`; or an agent that another Python package adds.
    :param weights: of the default pedestrian: a file, a name shipped with the package, or a `Bank` or `Weights`.
    :param always_critical: policies act from the first frame, critical or not.
    :raises InvalidInput: an unknown driver, scenario or weights file, or no scenario.
    """

    def __init__(
        self,
        scenarios: Iterable[int | str | Path],
        batch: int,
        *,
        vehicle: str = "external",
        pedestrian: str = "policy",
        weights: str | Path | Policy = "people",
        config: WorldConfig | None = None,
        always_critical: bool = False,
    ) -> None:
        self.scenarios = tuple(load_scenarios(scenarios))
        if not self.scenarios:
            raise InvalidInput("expected at least one scenario, got none")
        added = [name for name in AGENT_TYPES.names() if name != LEARNED]
        if pedestrian not in (*PEDESTRIANS, *added):
            raise InvalidInput(f"pedestrian = {pedestrian!r}: expected one of {', '.join((*PEDESTRIANS, *added))}")
        driver = "policy" if pedestrian in added else pedestrian
        self.config = dataclasses.replace(config or WorldConfig(), vehicle_driver=vehicle, pedestrian_driver=driver)
        self.world = World(self.config, self.scenarios, [], batch, 0)
        agents: dict[str, Agent] = {}
        self._learned: PolicyAgent | None = None
        if pedestrian in added:
            agents["pedestrian"] = make_agent("pedestrian", PolicyConfig(agent=pedestrian))
        elif pedestrian == "policy" and vehicle != "policy":
            agents["pedestrian"] = self._learned = PolicyAgent("pedestrian", 0, explore=False)
            self._learned.load(load_policy(weights) if isinstance(weights, (str, Path)) else weights, 1)
        self._loop = Loop(self.world, agents=agents, always_critical=always_critical)
        self._begun = [0] * batch  # episodes, of each slot
        self._seeds = [_NONE] * batch

    def seed(self, slot: int, seed: int) -> None:
        """Give this slot a new seed: the next `start` of the slot begins episode 0 of `seed`.

        :raises InvalidInput: a seed that is not from 0 to 2^63 - 1.
        """
        if not 0 <= operator.index(seed) < 2**63:
            raise InvalidInput(f"seed = {shown(seed)}: expected a whole number from 0 to 2^63 - 1")
        self._seeds[slot] = seed
        if self._learned is not None:
            self._learned.set_seeds(np.repeat(self._seeds, self.config.pedestrians))
        self._begun[slot] = 0

    def start(self, slots: Sequence[int], episode: tuple[int, int] | None = None) -> None:
        """Start the next episode of each of these slots, or in all of them `episode`, (scenario, episode number).

        A slot that never had a seed takes one from the system's entropy.

        :raises InvalidInput: a scenario that the simulation does not have, or an episode number out of range.
        """
        for slot in slots:
            if self._seeds[slot] == _NONE:
                self.seed(slot, secrets.randbelow(2**63))
        episodes = [episode or self._following(slot) for slot in slots]
        self.world.place(slots, episodes, [self._seeds[slot] for slot in slots])

    def _following(self, slot: int) -> tuple[int, int]:
        number, which = divmod(self._begun[slot], len(self.scenarios))
        self._begun[slot] += 1
        return self.scenarios[which].number, number

    def now(self) -> Snapshot:
        """Return the present state of all slots."""
        return self._shown(self.world.state.copy(), self._loop.assessment.curvttc)

    def step(self, given: Actions = NO_ACTIONS) -> Snapshot:
        """Advance by the policy period with `given` actions, a row for each slot; return the new state of all slots."""
        world, several = self.world, self.config.pedestrians
        if several > 1:
            arrays = {name: value for name, value in vars(given).items() if value is not None}
            given = Actions(**{name: np.repeat(value, several, axis=0) for name, value in arrays.items()})
        last, ttc = world.state.copy(), np.full(len(world.state), np.inf)
        for _ in range(self.config.policy_ticks):
            self._loop.step(given)
            present = world.state["status"] != IDLE
            last[present] = world.state[present]
            ttc[present] = self._loop.assessment.curvttc[present]
        return self._shown(last, ttc)

    def _shown(self, state: NDArray[np.void], curvttc: Floats) -> Snapshot:
        several = self.config.pedestrians
        if several == 1:
            return Snapshot(state, curvttc)
        first = np.arange(0, len(state), several)
        faced = first + curvttc.reshape(-1, several).argmin(axis=1)
        return Snapshot(state[faced], curvttc[faced])


def chosen_episode(options: dict[str, Any] | None) -> tuple[int, int] | None:
    """Return the (scenario number, episode number) that options of `reset` choose; None without options.

    :raises InvalidInput: other options, or only one of the two.
    """
    if not options:
        return None
    if set(options) != {"scenario", "episode"}:
        raise InvalidInput(f"options: expected scenario and episode, got {', '.join(sorted(options))}")
    return int(options["scenario"]), int(options["episode"])
