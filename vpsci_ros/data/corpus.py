"""The near misses that a run learns from: the files it names, or the synthetic sample."""

from collections.abc import Sequence
from pathlib import Path

import polars as pl

from vpsci_ros.data.near_misses import concat_near_misses, read_near_misses
from vpsci_ros.data.synthetic import synthetic_near_misses


def load_corpus(paths: Sequence[str | Path]) -> pl.DataFrame:
    """Return the near-miss tables of `paths` as one, interactions numbered through; no paths: the synthetic sample.

    :raises InvalidInput: a file is missing or does not hold a near-miss table.
    """
    if not paths:
        return synthetic_near_misses().table
    return concat_near_misses([read_near_misses(path) for path in paths])
