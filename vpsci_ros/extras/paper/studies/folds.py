"""Cross-validation by clip: every clip is held out in one fold, and errors of all folds are pooled."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import polars as pl

from vpsci_ros.data.interactions import Interactions, from_table
from vpsci_ros.data.near_misses import folds_by_clip
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.protocols import Measured, ProtocolErrors, eligible

Parts = list[tuple[pl.DataFrame, Interactions]]


def held_out_folds(near_misses: pl.DataFrame, folds: int, seed: int) -> tuple[Parts, Interactions]:
    """Return, for each fold, what is learned from and what is held out; and all that is held out, fold by fold.

    Held out are the interactions of a second or more of the fold's own clips.

    :raises InvalidInput: `folds` is not from 2 to the number of clips, or a fold has no such interaction.
    """
    tables = folds_by_clip(near_misses, folds, seed)
    parts = []
    for number, (training, held_out) in enumerate(tables, 1):
        try:
            parts.append((training, eligible(from_table(held_out))))
        except InvalidInput as error:
            raise InvalidInput(f"fold {number} of {folds}: {error}; take fewer folds") from None
    return parts, eligible(from_table(pl.concat([held_out for _, held_out in tables])))


def pooled(measured: Sequence[Measured]) -> Measured:
    """Return a model's errors in all folds, in the order of `held_out_folds`."""
    return {
        protocol: ProtocolErrors(
            *(np.concatenate([getattr(m[protocol], field.name) for m in measured]) for field in fields(ProtocolErrors))
        )
        for protocol in measured[0]
    }
