"""One browser for all pages of this folder."""

from collections.abc import Iterator
from typing import Any

import browser as real
import pytest


@pytest.fixture(scope="package")
def browser() -> Iterator[Any]:
    yield from real.start()
