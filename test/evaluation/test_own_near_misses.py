"""`benchmarks/own_near_misses.py`: what a draw of a place's own near misses holds."""

import importlib.util
from pathlib import Path
from types import ModuleType

import polars as pl
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.evaluation.onsets import find_onsets


@pytest.fixture(scope="module")
def benchmark() -> ModuleType:
    path = Path(__file__).parents[2] / "benchmarks" / "own_near_misses.py"
    spec = importlib.util.spec_from_file_location("own_near_misses", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def table() -> pl.DataFrame:
    """Near misses with 3 s after their onset, four of each clip."""
    made = synthetic_near_misses(interactions=24, seed=3).table
    made = made.filter(pl.col("interaction").is_in(find_onsets(made).number))
    return made.with_columns(clip=pl.format("clip {}", pl.col("interaction").rle_id() // 4))


def test_a_draw_is_of_whole_clips_but_the_last_and_of_as_many_near_misses_as_asked(
    benchmark: ModuleType, table: pl.DataFrame
) -> None:
    seen = set()
    for seed in range(5):
        one = benchmark.drawn(table, 10, seed)
        counts = one.group_by("clip").agg(pl.col("interaction").n_unique())["interaction"].sort().to_list()
        assert counts == [2, 4, 4]
        assert one.equals(benchmark.drawn(table, 10, seed))
        seen.add(tuple(one["interaction"].unique().sort()))
    assert len(seen) > 1
    with pytest.raises(SystemExit, match="expected at least 1000 near misses"):
        benchmark.drawn(table, 1000, 0)
