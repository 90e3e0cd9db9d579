"""Table 5's rates: collisions and goals among the critical episodes of a simulation, with intervals."""

import math

import numpy as np

from vpsci_ros.evaluation.outcomes import Outcomes
from vpsci_ros.evaluation.statistics import wilson_interval
from vpsci_ros.world import COLLISION, GOAL


def rates_with_intervals(outcomes: Outcomes) -> dict[str, float]:
    """Return Table 5's rates of all critical episodes with their 95% intervals, and quartiles of the least CurvTTC [s].

    Names: critical_episodes; collision_rate, collision_low, collision_high; likewise for goal; timeout_rate, the share
    of all other outcomes; least_curvttc_25, _50, _75. Where no episode was critical, rates and quartiles are NaN and
    intervals 0 to 1.
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
