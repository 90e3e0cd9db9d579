"""A table of near misses, for the tests of this room."""

from pathlib import Path

import polars as pl
import pytest

from vpsci_ros.data.near_misses import write_near_misses


@pytest.fixture(scope="session")
def table_file(near_misses: pl.DataFrame, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "people.parquet"
    write_near_misses(near_misses, path)
    return path
