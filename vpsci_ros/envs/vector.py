"""The right turn as a Gymnasium vector environment: a batch in one world, one call a step."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from vpsci_ros.envs import task
from vpsci_ros.envs.rendering import Views
from vpsci_ros.envs.simulation import Simulation, Snapshot
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.world import WorldConfig
from vpsci_ros.world.tables import tables_from
from vpsci_ros.world.tick import Actions

Infos = dict[str, Any]
Step = tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]
OBSERVATION_SPACE = spaces.Box(-task.BOUND, task.BOUND, (task.SIZE,), np.float32)
ACTION_SPACE = spaces.Box(-1.0, 1.0, (2,), np.float32)


class RightTurnVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]):
    """`num_envs` independent right turns; environment i is bit-identical to `RightTurnEnv` with seed + i.

    An environment whose episode ends starts the next one in the same step (autoreset mode "same step"): the returned
    observation is the new episode's first; the old episode's last one is in `infos["final_obs"]`.

    :param num_envs: number of environments; other parameters as for `RightTurnEnv`.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        scenarios: Iterable[int | str | Path] = range(1, 9),
        pedestrian: str = "policy",
        weights: str | Path | Policy = "people",
        render_mode: str | None = None,
        config: WorldConfig | None = None,
    ) -> None:
        self.num_envs, self.render_mode = num_envs, render_mode
        self.single_observation_space, self.single_action_space = OBSERVATION_SPACE, ACTION_SPACE
        self.observation_space = batch_space(OBSERVATION_SPACE, num_envs)
        self.action_space = batch_space(ACTION_SPACE, num_envs)
        self._simulation = Simulation(scenarios, num_envs, pedestrian=pedestrian, weights=weights, config=config)
        self._tables = tables_from(self._simulation.scenarios, self._simulation.config.spawn)
        self._views = Views(self._simulation.scenarios, render_mode)
        self._last: Snapshot | None = None

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], Infos]:
        """Start an episode in each environment: episode 0 of seed + i in environment i, or the next one without a seed.

        An environment that has no seed yet takes one from the system's entropy.

        :raises InvalidInput: any options, a list of seeds of another length, or a seed out of range.
        """
        if options:
            raise InvalidInput(f"options: this environment has none, got {options}")
        seeds = seed if isinstance(seed, list) else [None if seed is None else seed + i for i in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise InvalidInput(f"seed: expected one number or {self.num_envs} of them, got {len(seeds)}")
        first, self._last = self.begin(seeds)
        return first, self._infos(self._last)

    def begin(
        self, seeds: Sequence[int | None], episode: tuple[int, int] | None = None
    ) -> tuple[NDArray[np.float32], Snapshot]:
        """Start an episode in each environment, see `reset`, or `episode`; return the observations and the state."""
        for slot, own in enumerate(seeds):
            if own is not None:
                self._simulation.seed(slot, own)
        self._simulation.start(range(self.num_envs), episode)
        self._last = self._simulation.now()
        return task.observe(self._last.state, self._last.curvttc, self._tables), self._last

    def advance(self, actions: NDArray[np.float32]) -> tuple[Step, Snapshot]:
        """Advance by 0.1 s, without a new episode; return what `step` does but the infos, and the state.

        :raises ResetNeeded: Gymnasium's error, before the first `reset`.
        """
        if self._last is None:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        before = self._last.state
        self._last = step = self._simulation.step(Actions(vehicle_control=task.controls(actions)))
        observation = task.observe(step.state, step.curvttc, self._tables)
        return (observation, *task.outcome(before, step.state, observation)), step

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Infos]:
        """Advance all environments by 0.1 s; return observations, rewards, terminated, truncated and infos.

        Actions are float32[num_envs, 2]; the first axis of each returned array is the environment.

        :raises ResetNeeded: Gymnasium's error, before the first `reset`.
        """
        (observation, reward, terminated, truncated), step = self.advance(actions)
        infos = self._infos(step)
        over = terminated | truncated
        if over.any():
            final = np.full(self.num_envs, None, object)
            for slot in np.flatnonzero(over):
                final[slot] = observation[slot].copy()
            infos |= {"final_obs": final, "_final_obs": over, "final_info": self._infos(step), "_final_info": over}
            self._simulation.start(np.flatnonzero(over).tolist())
            self._last = self._simulation.now()
            fresh = task.observe(self._last.state, self._last.curvttc, self._tables)
            observation[over] = fresh[over]
        return observation, reward, terminated, truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return the scenes from above, uint8[480, 480, 3] each, in render mode "rgb_array"; otherwise None."""
        return self._views.images(self._last)

    def _infos(self, step: Snapshot) -> Infos:
        everywhere = np.ones(self.num_envs, bool)
        infos: Infos = {
            "scenario": step.state["scenario"].astype(np.int64),
            "episode_number": step.state["episode"].astype(np.int64),
            "outcome": step.state["outcome"].astype(np.int64),
            "curvttc": step.curvttc,
            "pedestrian_controlled": step.state["controlled"] != 0,
        }
        return infos | {f"_{name}": everywhere for name in infos}
