"""Folds by clip: every clip is held out in one fold, and errors of all folds are pooled."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import polars as pl

from vpsci_ros.data.corpus import place_of, split_off
from vpsci_ros.data.interactions import Interactions, from_table
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.protocols import Measured, ProtocolErrors, eligible

Parts = list[tuple[pl.DataFrame, Interactions]]


def held_out_folds(near_misses: pl.DataFrame, folds: int, seed: int) -> tuple[Parts, Interactions]:
    """Return training and held-out data of each fold, and all held-out data in the order of the folds.

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


def folds_by_clip(table: pl.DataFrame, folds: int, seed: int) -> list[tuple[pl.DataFrame, pl.DataFrame]]:
    """Return (training, held out) of each fold: every clip is held out exactly once; folds have similar sizes.

    Clips, those with most interactions first and then in the order of a hash of (seed, source, clip), go to the fold
    that has the fewest interactions so far.

    :param folds: 2 or more, at most the number of clips.
    :raises InvalidInput: another number of folds.
    """
    counts = table.group_by("source", "clip").agg(pl.col("interaction").n_unique().alias("n")).rows()
    if not 2 <= folds <= len(counts):
        raise InvalidInput(f"folds = {folds}: expected 2 to {len(counts)}, the number of clips")
    members: list[list[tuple[str, str]]] = [[] for _ in range(folds)]
    sizes = [0] * folds
    for source, clip, n in sorted(counts, key=lambda row: (-row[2], place_of(seed, row[0], row[1]))):
        lightest = sizes.index(min(sizes))
        members[lightest].append((source, clip))
        sizes[lightest] += n
    return [split_off(table, held) for held in members]
