"""The picture of recorded and generated near misses is drawn of both tables, or says which has none."""

from pathlib import Path

import polars as pl
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.errors import InvalidInput
from vpsci_ros.report.beside import save_beside


def test_both_are_drawn_and_the_same_seed_draws_the_same(tmp_path: Path) -> None:
    tables = [synthetic_near_misses(interactions=count, seed=3).table for count in (14, 5)]
    for name, seed in (("one", 1), ("again", 1), ("other", 2)):
        save_beside(*tables, tmp_path / f"{name}.png", seed)
    one, again, other = ((tmp_path / f"{name}.png").read_bytes() for name in ("one", "again", "other"))
    assert one == again != other


def test_a_table_without_an_onset_is_refused_by_its_name(tmp_path: Path) -> None:
    table = synthetic_near_misses(interactions=4, seed=3).table
    none = table.with_columns(curvttc_causal=pl.lit(9.0))
    with pytest.raises(InvalidInput, match="generated: expected an interaction with CurvTTC below 5 s"):
        save_beside(table, none, tmp_path / "x.png")
    assert not (tmp_path / "x.png").exists()
