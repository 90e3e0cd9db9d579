"""The held-out error: both protocols on near misses of clips that training never sees, beside the control."""

import polars as pl

from vpsci_ros.data.interactions import Interactions, from_table
from vpsci_ros.data.near_misses import split_by_clip
from vpsci_ros.evaluation.predictors import PolicyPredictor, RepeatVelocity
from vpsci_ros.evaluation.protocols import closed_loop, eligible, reconstruct
from vpsci_ros.policy.weights import Weights


class HeldOut:
    """Measures weights on held-out interactions; the control's errors are known once and for all.

    :param table: near-miss table of the held-out clips.
    :raises InvalidInput: none of them lasts a second.
    """

    def __init__(self, table: pl.DataFrame) -> None:
        self.interactions: Interactions = eligible(from_table(table))
        control = RepeatVelocity()
        reconstruction = reconstruct(control, self.interactions)
        loop = closed_loop(control, self.interactions)
        self.control = {
            "reconstruction_ade": float(reconstruction.ade.mean()),
            "reconstruction_fde": float(reconstruction.fde.mean()),
            "closed_loop_ade": float(loop.ade.mean()),
            "closed_loop_fde": float(loop.fde.mean()),
        }

    def errors(self, weights: Weights) -> dict[str, float]:
        """Return ADE and FDE [m] of both protocols, means over interactions and agents."""
        policy = PolicyPredictor(weights)
        reconstruction, loop = reconstruct(policy, self.interactions), closed_loop(policy, self.interactions)
        return {
            "reconstruction_ade": float(reconstruction.ade.mean()),
            "reconstruction_fde": float(reconstruction.fde.mean()),
            "closed_loop_ade": float(loop.ade.mean()),
            "closed_loop_fde": float(loop.fde.mean()),
        }


def split_as_before(
    near_misses: pl.DataFrame, weights: Weights, fraction: float, seed: int
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return near misses to learn from, and those of the clips that `weights` were not trained on.

    If the table has none of these clips, `fraction` of it is held out, by whole clips.
    """
    clips = weights.facts.get("data", {}).get("held_out_clips", [])
    held = pl.concat_str("source", "clip", separator="/").is_in(clips)
    held_out = near_misses.filter(held)
    if held_out.is_empty():
        return split_by_clip(near_misses, fraction, seed)
    return near_misses.filter(~held), held_out
