"""Bags written without ROS, for the tests of this room."""

from pathlib import Path

import pytest
from bags.copied import copied


@pytest.fixture(scope="session")
def foreign(own_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The states of `own_bag` as another tool would have recorded them; not to be changed."""
    return copied(own_bag, tmp_path_factory.mktemp("foreign") / "bag")
