"""How policies do on simulated episodes that they have not learned on: without exploration, by another seed."""

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.learning.config import AGENTS
from vpsci_ros.learning.online import Outcomes
from vpsci_ros.learning.rollout import Acting, policies, rollout
from vpsci_ros.learning.weights import Weights
from vpsci_ros.world import COLLISION, GOAL, Scenario, World, WorldConfig
from vpsci_ros.world.monitor import MonitorConfig

LEVEL = 0.95


class NoAcceleration:
    """The control in simulation: whoever is handed to it keeps its speed (and the vehicle its lane)."""

    def act(
        self,
        state: NDArray[np.void],
        policy_frame: NDArray[np.bool_],
        curvttc: NDArray[np.float64],
        critical: NDArray[np.bool_],
    ) -> NDArray[np.float32]:
        """See `PolicyAgent.act`."""
        return np.zeros((len(state), 2), np.float32)


def measure_outcomes(
    weights: Weights | None,
    *,
    scenarios: Sequence[Scenario],
    episodes: Sequence[tuple[int, int]],
    batch: int,
    seed: int,
    world: WorldConfig | None = None,
    monitor: MonitorConfig | None = None,
) -> Outcomes:
    """Simulate `episodes` under these policies, without exploration, and return how the critical ones ended.

    :param weights: of both agents; None: `NoAcceleration`.
    :param episodes: (scenario number, episode number) pairs.
    :param seed: of the world; take another one than training had.
    """
    simulation = World(world or WorldConfig(), scenarios, episodes, min(batch, len(episodes)), seed)
    agents: dict[str, Acting] = dict.fromkeys(AGENTS, NoAcceleration())
    if weights is not None:
        agents = dict(policies(weights, simulation, seed, explore=False))
    outcomes = Outcomes()
    for tick in rollout(simulation, monitor or MonitorConfig(), agents):
        outcomes.note(tick.events)
    return outcomes


def rates_with_intervals(outcomes: Outcomes) -> dict[str, float]:
    """Return Table 5's rates of all critical episodes with their 95% intervals, and quartiles of the least CurvTTC [s].

    Names: critical_episodes; collision_rate, collision_low, collision_high; the same of goal; timeout_rate;
    least_curvttc_25, _50, _75. Rates are NaN where no episode was critical.
    """
    ended = np.array(outcomes.outcomes)
    row: dict[str, float] = {"critical_episodes": len(ended)}
    for name, outcome in (("collision", COLLISION), ("goal", GOAL)):
        count = int((ended == outcome).sum())
        row[f"{name}_rate"] = count / len(ended) if len(ended) else math.nan
        row[f"{name}_low"], row[f"{name}_high"] = wilson_interval(count, len(ended))
    row["timeout_rate"] = 1.0 - row["collision_rate"] - row["goal_rate"]
    for percent in (25, 50, 75):
        known = bool(outcomes.least_curvttc)
        row[f"least_curvttc_{percent}"] = float(np.percentile(outcomes.least_curvttc, percent)) if known else math.nan
    return row


def wilson_interval(count: int, total: int) -> tuple[float, float]:
    """Return the 95% score interval of a rate of `count` in `total` trials; (0, 1) where there were none.

    See Wilson, 'Probable Inference, the Law of Succession, and Statistical Inference' (1927).
    """
    if total == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf(0.5 + 0.5 * LEVEL)
    rate, spread = count / total, z * z / total
    half = z * math.sqrt(rate * (1.0 - rate) / total + spread / (4.0 * total))
    centre = rate + 0.5 * spread
    return max(0.0, (centre - half) / (1.0 + spread)), min(1.0, (centre + half) / (1.0 + spread))
