"""An episode is a pure function of (seed, scenario, number) and the policies: the same bits, however it is run."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from world.helpers import run

from vpsci_ros.world import WorldConfig

PAIRS = [(scenario, number) for number in range(4) for scenario in range(1, 9)]
CONFIG = WorldConfig()
FOLDER = Path(__file__).resolve().parents[1]


def digest(found) -> str:
    return hashlib.sha256(b"".join(found[key].tobytes() for key in sorted(found))).hexdigest()


@pytest.fixture(scope="module")
def reference():
    return run(PAIRS, batch=7, config=CONFIG)


def test_bits_depend_neither_on_the_order_of_the_queue_nor_on_the_batch(reference):
    order = np.random.default_rng(1).permutation(len(PAIRS))
    found = run([PAIRS[i] for i in order], batch=5, config=CONFIG)
    assert found.keys() == reference.keys()
    assert digest(found) == digest(reference)


def test_bits_do_not_depend_on_the_number_of_threads(reference, monkeypatch):
    monkeypatch.setattr("vpsci_ros.world.world.PER_THREAD", 3)
    monkeypatch.setattr("vpsci_ros.world.world.SPAWNS_PER_THREAD", 3)
    monkeypatch.setattr("vpsci_ros.safety.compiled._pool.size", 4)
    assert digest(run(PAIRS, batch=64, config=CONFIG)) == digest(reference)


def test_bits_are_the_same_in_another_process(reference):
    code = (
        "from world.helpers import run; from world.test_repeatability import CONFIG, PAIRS, digest;"
        "print(digest(run(PAIRS, batch=11, config=CONFIG)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=FOLDER, timeout=120)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == digest(reference)
