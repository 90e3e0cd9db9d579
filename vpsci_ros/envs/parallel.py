"""Both agents as a PettingZoo parallel environment: equations (6)-(13) and (18)-(26) of the paper."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from vpsci_ros.envs.rendering import Views
from vpsci_ros.envs.simulation import Simulation, Snapshot, chosen_episode
from vpsci_ros.learning.training_config import RewardsConfig
from vpsci_ros.world import COLLISION, GOAL, PARKED_COLLISION, TIMEOUT, WorldConfig
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS, OBSERVATION_SIZE, observe
from vpsci_ros.world.tick import Actions

BOUND = 500.0  # no entry of an observation is larger
ACTION_LIMIT = 5.0  # [m/s2]
COLLISION_REWARD, GOAL_REWARD = RewardsConfig.collision, RewardsConfig.goal  # (25) and (26)

Observations = dict[str, NDArray[np.float32]]


class VehiclePedestrianEnv(ParallelEnv[str, NDArray[np.float32], NDArray[np.float32]]):
    """Vehicle and pedestrian, both under the user's control from the first frame, 0.1 s a step.

    Observations are (6) and (7), float32[6]; actions accelerations (longitudinal, lateral) [m/s2], both in the
    vehicle's heading frame, which become motion by (18)-(20) and (21)-(24). Reward: (25), -200 to both when the vehicle
    hits the pedestrian, and (26), 100 to an agent at its own goal. The episode ends for both together.

    :param scenarios: numbers, names or files; episodes take them in turn.
    :param lane_following: the world keeps the vehicle's lane, since observation (6) does not contain the road.
    :param render_mode: "rgb_array" or None.
    :param pedestrian_gain: share of the pedestrian's acceleration that becomes motion; 0.5 in (21)-(24).
    :raises InvalidInput: an unknown scenario or render mode.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "vehicle_pedestrian_v0",
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        scenarios: Iterable[int | str | Path] = range(1, 9),
        lane_following: bool = True,
        render_mode: str | None = None,
        pedestrian_gain: float = 1.0,
    ) -> None:
        self.render_mode = render_mode
        self.possible_agents = list(AGENTS)
        self.agents: list[str] = []
        config = WorldConfig(lane_following=lane_following, pedestrian_gain=pedestrian_gain)
        self._simulation = Simulation(
            scenarios, 1, vehicle="policy", pedestrian="policy", config=config, always_critical=True
        )
        self._views = Views(self._simulation.scenarios, render_mode)
        self._observation_space = spaces.Box(-BOUND, BOUND, (OBSERVATION_SIZE,), np.float32)
        self._action_space = spaces.Box(-ACTION_LIMIT, ACTION_LIMIT, (ACTION_SIZE,), np.float32)
        self._last: Snapshot | None = None

    def observation_space(self, agent: str) -> spaces.Box:
        """Return the space of an agent's observations, equation (6) or (7): float32[6], each within +-500."""
        return self._observation_space

    def action_space(self, agent: str) -> spaces.Box:
        """Return the space of an agent's accelerations (longitudinal, lateral): float32[2], -5 to 5 m/s2."""
        return self._action_space

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, dict[str, Any]]]:
        """Start an episode as `RightTurnEnv.reset` does, but ignore options other than scenario and episode.

        :raises InvalidInput: a seed out of range, or only one of scenario and episode.
        """
        if seed is not None:
            self._simulation.seed(0, seed)
        known: dict[str, Any] = {key: value for key, value in (options or {}).items() if key in ("scenario", "episode")}
        self._simulation.start([0], chosen_episode(known))
        self.agents = list(AGENTS)
        self._last = self._simulation.now()
        return self._seen(self._last)

    def step(
        self, actions: dict[str, NDArray[np.float32]]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Advance both agents by 0.1 s; return observations, rewards, terminations, truncations and infos by agent."""
        assert self._last is not None, "call reset() before step()"
        before = self._last.state[0]
        vehicle, pedestrian = (
            np.clip(np.asarray(actions[a], np.float64), -ACTION_LIMIT, ACTION_LIMIT)[None] for a in AGENTS
        )
        self._last = self._simulation.step(Actions(vehicle, pedestrian))
        after = self._last.state[0]
        collision = COLLISION_REWARD if after["outcome"] == COLLISION else 0.0
        reward = {a: collision + GOAL_REWARD * int(after[f"{a}_goal"] > before[f"{a}_goal"]) for a in AGENTS}
        terminated = bool(after["outcome"] in (COLLISION, GOAL, PARKED_COLLISION))
        truncated = bool(after["outcome"] == TIMEOUT)
        if terminated or truncated:
            self.agents = []
        observations, infos = self._seen(self._last)
        return observations, reward, dict.fromkeys(AGENTS, terminated), dict.fromkeys(AGENTS, truncated), infos

    def render(self) -> NDArray[np.uint8] | None:
        """Return the scene from above, uint8[480, 480, 3], in render mode "rgb_array"; otherwise None."""
        pictures = self._views.images(self._last)
        return None if pictures is None else pictures[0]

    @staticmethod
    def _seen(last: Snapshot) -> tuple[Observations, dict[str, dict[str, Any]]]:
        pairs = zip(AGENTS, observe(last.state), strict=True)
        observations = {agent: np.clip(rows[0], -BOUND, BOUND) for agent, rows in pairs}
        return observations, {agent: last.info() for agent in AGENTS}


def parallel_env(**kwargs: Any) -> VehiclePedestrianEnv:
    """Return a `VehiclePedestrianEnv`; PettingZoo's tools expect a function of this name."""
    return VehiclePedestrianEnv(**kwargs)
