"""The near misses that a run learns from: the files it names, or the package's own."""

from collections.abc import Sequence
from pathlib import Path

import polars as pl

from vpsci_ros.data.near_misses import concat_near_misses, read_near_misses
from vpsci_ros.resources import RIGHT_TURNS, near_misses_path


def corpus_files(names: Sequence[str | Path]) -> list[Path]:
    """Return the near-miss tables that `names` mean: paths, or the package's right turns, also where there is none."""
    return [near_misses_path(name) for name in names or [RIGHT_TURNS]]


def load_corpus(names: Sequence[str | Path]) -> pl.DataFrame:
    """Return the near-miss tables of `corpus_files` as one, interactions numbered through.

    :raises InvalidInput: a file is missing or does not hold a near-miss table.
    """
    return concat_near_misses([read_near_misses(path) for path in corpus_files(names)])
