"""The held-out error: both protocols on near misses of clips that training never sees, for weights and controls."""

import polars as pl

from vpsci_ros.data.interactions import Interactions, from_table
from vpsci_ros.data.near_misses import split_by_clip, split_by_name
from vpsci_ros.evaluation.predictors import PolicyPredictor, RepeatVelocity
from vpsci_ros.evaluation.protocols import Measured, continued, eligible, measure
from vpsci_ros.policy.weights import Weights


class HeldOut:
    """Measures weights on held-out interactions; the controls' errors are computed once.

    :ivar control, fading: errors of the last velocity repeated, and of the last acceleration, see `errors.continued`.
    :param table: near-miss table of the held-out clips.
    :raises InvalidInput: no interaction has a second from its first critical step to the last.
    """

    def __init__(self, table: pl.DataFrame) -> None:
        self.interactions: Interactions = eligible(from_table(table))
        self.control = _by_name(measure(RepeatVelocity(), self.interactions))
        self.fading = _by_name(continued(self.interactions))

    def errors(self, weights: Weights) -> dict[str, float]:
        """Return ADE and FDE [m] of both protocols by name (`closed_loop_ade`), means over interactions and agents."""
        return _by_name(measure(PolicyPredictor(weights), self.interactions))


def _by_name(measured: Measured) -> dict[str, float]:
    return {
        f"{protocol}_{name}": float(getattr(errors, name).mean())
        for protocol, errors in measured.items()
        for name in ("ade", "fde")
    }


SHARE, SPLIT = 0.2, 1  # of the near misses that is held out where no clips are named, as in the paper; and its seed
NO_CLIPS = "none"  # in place of names: none is held out


def held_out_by(near_misses: pl.DataFrame, names: list[str]) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return near misses to train on, and those held out.

    :param names: of clips to hold out, see `split_by_name`; none: a fifth, by whole clips, the same in every
        training; [`NO_CLIPS`]: none.
    :raises InvalidInput: as `split_by_name` and `split_by_clip`.
    """
    if names == [NO_CLIPS]:
        return near_misses, near_misses.clear()
    return split_by_name(near_misses, names) if names else split_by_clip(near_misses, SHARE, SPLIT)


def split_as_before(near_misses: pl.DataFrame, weights: Weights) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return near misses to train on, and those of the clips that were held out when `weights` were trained.

    If the table has none of these clips, a fifth of it is held out, by whole clips.

    :raises InvalidInput: as `split_by_clip`, if that is used.
    """
    clips = weights.facts.get("data", {}).get("held_out_clips", [])
    held = pl.concat_str("source", "clip", separator="/").is_in(clips)
    held_out = near_misses.filter(held)
    if held_out.is_empty():
        return split_by_clip(near_misses, SHARE, SPLIT)
    return near_misses.filter(~held), held_out
