import numpy as np
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.evaluation.onsets import Onsets, find_onsets


@pytest.fixture(scope="session")
def onsets() -> Onsets:
    """Onsets of forty synthetic encounters, each a clip of its own."""
    return find_onsets(synthetic_near_misses(interactions=40, seed=3).table)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
