"""The right turn as a Gymnasium environment: the user drives the vehicle, the pedestrian reacts."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from vpsci_ros.envs.simulation import chosen_episode
from vpsci_ros.envs.vector import ACTION_SPACE, OBSERVATION_SPACE, RightTurnVectorEnv
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.world import WorldConfig


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
        self.render_mode = render_mode
        self.observation_space, self.action_space = OBSERVATION_SPACE, ACTION_SPACE
        self._one = RightTurnVectorEnv(1, scenarios, pedestrian, weights, render_mode, config)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; the class's docstring describes `seed` and `options`.

        :raises InvalidInput: an option other than scenario and episode, only one of the two, or a seed out of range.
        """
        super().reset(seed=seed)
        observation, last = self._one.begin([seed], chosen_episode(options))
        return observation[0], last.info()

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance by 0.1 s with an action float[2]; return observation, reward, terminated, truncated and info.

        :raises ResetNeeded: Gymnasium's error, before the first `reset`.
        """
        (observation, reward, terminated, truncated), last = self._one.advance(np.asarray(action)[None])
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), last.info()

    def render(self) -> NDArray[np.uint8] | None:
        """Return the scene from above, uint8[480, 480, 3], in render mode "rgb_array"; otherwise None."""
        pictures = self._one.render()
        return None if pictures is None else pictures[0]
