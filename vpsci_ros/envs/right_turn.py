"""The right turn as a Gymnasium environment: the user drives the vehicle, the pedestrian reacts."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from vpsci_ros.envs import task
from vpsci_ros.envs.rendering import Views
from vpsci_ros.envs.simulation import Simulation, Snapshot
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.world import OUTCOME_NAMES, WorldConfig
from vpsci_ros.world.tables import tables_from
from vpsci_ros.world.tick import Actions

OBSERVATION_SPACE = spaces.Box(-task.BOUND, task.BOUND, (task.SIZE,), np.float32)
ACTION_SPACE = spaces.Box(-1.0, 1.0, (2,), np.float32)


class RightTurnEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """The right-turn environment, one episode at a time; `vpsci_ros.envs.task` has observation, action and reward.

    A step is the policy period, 0.1 s. An episode terminates on collision, at the vehicle's goal and off the lane, and
    is truncated after `episode_time` (30 s). `reset(seed=...)` starts episode 0 of that seed, each later reset the
    next one; `options={"scenario": 3, "episode": 17}` starts that episode. Without any seed, the first reset takes one
    from the system's entropy.

    :param scenarios: numbers, names or files; episodes take them in turn.
    :param pedestrian: "policy", or a reference pedestrian: "autopilot", "constant_velocity", "social_force"; or an
        agent that another Python package adds.
    :param weights: of the default pedestrian: a file, a name shipped with the package, or a `Bank` or `Weights`.
    :param render_mode: "rgb_array" or None.
    :param config: of the world; of several `pedestrians` the one with the least CurvTTC is observed.
    :raises InvalidInput: an unknown scenario, pedestrian, weights file or render mode.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        scenarios: Iterable[int | str | Path] = range(1, 9),
        pedestrian: str = "policy",
        weights: str | Path | Policy = "people",
        render_mode: str | None = None,
        config: WorldConfig | None = None,
    ) -> None:
        check_render_mode(render_mode)
        self.render_mode = render_mode
        self.observation_space, self.action_space = OBSERVATION_SPACE, ACTION_SPACE
        self._simulation = Simulation(scenarios, 1, pedestrian=pedestrian, weights=weights, config=config)
        self._tables = tables_from(self._simulation.scenarios, self._simulation.config.spawn)
        self._views = Views(self._simulation.scenarios)
        self._last: Snapshot | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; the class's docstring describes `seed` and `options`.

        :raises InvalidInput: an option other than scenario and episode, only one of the two, or a seed out of range.
        """
        super().reset(seed=seed)
        if seed is not None:
            self._simulation.seed(0, seed)
        self._simulation.start([0], chosen_episode(options))
        self._last = self._simulation.now()
        return task.observe(self._last.state, self._last.curvttc, self._tables)[0], self._info(self._last)

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance by 0.1 s with an action float[2]; return observation, reward, terminated, truncated and info.

        :raises ResetNeeded: Gymnasium's error, before the first `reset`.
        """
        if self._last is None:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        before = self._last.state
        self._last = self._simulation.step(Actions(vehicle_control=task.controls(np.asarray(action)[None])))
        observation = task.observe(self._last.state, self._last.curvttc, self._tables)
        reward, terminated, truncated = task.outcome(before, self._last.state, observation)
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), self._info(self._last)

    def render(self) -> NDArray[np.uint8] | None:
        """Return the scene from above, uint8[480, 480, 3], in render mode "rgb_array"; otherwise None."""
        if self.render_mode is None or self._last is None:
            return None
        return self._views.image(self._last.state[0])

    @staticmethod
    def _info(step: Snapshot) -> dict[str, Any]:
        record = step.state[0]
        return {
            "scenario": int(record["scenario"]),
            "episode_number": int(record["episode"]),
            "outcome": OUTCOME_NAMES[record["outcome"]],
            "curvttc": float(step.curvttc[0]),
            "pedestrian_controlled": bool(record["controlled"]),
        }


def check_render_mode(render_mode: str | None) -> None:
    """Refuse a render mode other than "rgb_array" and None.

    :raises InvalidInput: another render mode.
    """
    if render_mode not in (None, "rgb_array"):
        raise InvalidInput(f"render_mode = {render_mode!r}: expected 'rgb_array' or None")


def chosen_episode(options: dict[str, Any] | None) -> tuple[int, int] | None:
    """Return the (scenario number, episode number) that options of `reset` choose; None without options.

    :raises InvalidInput: other options, or only one of the two.
    """
    if not options:
        return None
    if set(options) != {"scenario", "episode"}:
        raise InvalidInput(f"options: expected scenario and episode, got {', '.join(sorted(options))}")
    return int(options["scenario"]), int(options["episode"])
