"""The near misses that a run learns from: the files it names, or the package's own."""

from collections.abc import Sequence
from pathlib import Path

import polars as pl

from vpsci_ros.data.near_misses import concat_near_misses, read_near_misses
from vpsci_ros.resources import TO_LEARN_FROM, near_misses_path


def corpus_files(names: Sequence[str | Path]) -> list[Path]:
    """Return the files of the near-miss tables that `names` mean; without a name, of the package's right turns."""
    return [near_misses_path(name) for name in names or [TO_LEARN_FROM]]


def load_corpus(names: Sequence[str | Path]) -> pl.DataFrame:
    """Return these near-miss tables, or parts of tables, as one, interactions numbered through.

    :param names: see `read_near_misses`; none: the training part of the package's right turns.

    :raises InvalidInput: a file is missing or does not hold a near-miss table.
    """
    return concat_near_misses([read_near_misses(name) for name in names or [TO_LEARN_FROM]])
