"""A loss that is not a number stops the run, and the batch that did it is kept."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import VpsciError
from vpsci_ros.kinematics.scene import Scene
from vpsci_ros.learning.replay import Batch
from vpsci_ros.runs.files import written_whole

DIVERGED = "diverged.npz"


class DivergedError(VpsciError):
    """A loss, or what is made of losses, is no longer a number."""


def check_losses(losses: Mapping[str, float], batch: Batch, iteration: int, out_dir: Path | None) -> None:
    """Let finite losses pass; else save the batch as `diverged.npz` in `out_dir` and raise.

    :raises DivergedError: a loss is not finite.
    """
    if all(map(math.isfinite, losses.values())):
        return
    where = "nowhere, since there is no output folder"
    if out_dir is not None:
        out_dir.mkdir(parents=True, exist_ok=True)
        with written_whole(out_dir / DIVERGED) as part, open(part, "wb") as file:
            np.savez(file, **_arrays(batch))
        where = f"in {out_dir / DIVERGED}"
    bad = ", ".join(f"{name} = {value}" for name, value in losses.items() if not math.isfinite(value))
    raise DivergedError(
        f"update {iteration}: expected finite losses, got {bad}; the batch is {where}; "
        "lower the learning rates, or look for outliers in the data"
    )


def require_finite_reward_weights(values: NDArray[np.float64]) -> None:
    """Let finite weights of rewards pass, float64[2, 3], (collision, goal, speed) of each agent.

    :raises DivergedError: one is not finite, so what the actors followed is not known.
    """
    if not np.isfinite(values).all():
        raise DivergedError(
            f"stage 2: expected finite weights of rewards (collision, goal, speed), got {values.tolist()}; no weights "
            "are written; refine again from the weights of stage 1, and look for outliers in the recorded experience"
        )


def _arrays(batch: Batch) -> dict[str, Any]:
    arrays: dict[str, Any] = {}
    for name, value in vars(batch).items():
        value = value._asdict() if isinstance(value, Scene) else value  # noqa: PLW2901
        parts = {f"{name}.{k}": v for k, v in value.items()} if isinstance(value, dict) else {name: value}
        parts = {k: v for k, v in parts.items() if v is not None}
        arrays |= {k: v.detach().numpy() for k, v in parts.items()}
    return arrays
