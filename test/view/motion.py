"""Episodes of motion that is given as columns, as the page's tests want them."""

from typing import Any

import numpy as np

from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.view.view_page import FIELDS
from vpsci_ros.world import Scenario


def episode(
    values: np.ndarray,
    name: str = "1:0",
    group: str = "place",
    scenario: Scenario | int = 1,
    outcome: str = "goal",
    others: np.ndarray | None = None,
    **more: Any,
) -> Episode:
    """Return the episode of float64[T, 11], `FIELDS`, with further pedestrians float64[n, T, 4]."""
    columns = dict(zip(FIELDS, values.T, strict=True))
    others = np.zeros((0, len(values), 4)) if others is None else others
    walk = [np.stack([columns[key], *others[..., i]]) for i, key in enumerate(("ped_x", "ped_y", "ped_vx", "ped_vy"))]
    far = np.full((len(others), len(values)), np.inf)
    number = scenario if isinstance(scenario, int) else scenario.number
    listed = Listed(name, group, number, 0, outcome, float(np.nanmin(columns["curvttc"])))
    return Episode(
        *("test", listed, None if isinstance(scenario, int) else scenario, more.pop("period", 0.1)),
        *(columns[key] for key in FIELDS[:5]),
        *walk,
        curvttc=np.concatenate([columns["curvttc"][None], far]),
        distance=np.hypot(columns["x"] - walk[0], columns["y"] - walk[1]),
        controlled=np.concatenate([columns["held"][None] == 1.0, far < 0.0]),
        seen=np.ones(walk[0].shape, np.bool_),
        **more,
    )
