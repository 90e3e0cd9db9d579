"""An episode is a pure function of (seed, scenario, number) and the policies: the same bits, however it is run."""

import hashlib
import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from world.helpers import SCENARIOS, episodes, run

from vpsci_ros.world import World, WorldConfig

PAIRS = [(scenario, number) for number in range(8) for scenario in range(1, 9)]
CONFIG = WorldConfig()
PAPER = WorldConfig(spawn="paper")
FOLDER = Path(__file__).resolve().parents[1]


def digest(found) -> str:
    return hashlib.sha256(b"".join(found[key].tobytes() for key in sorted(found))).hexdigest()


@pytest.fixture(scope="module")
def reference():
    return run(PAIRS, batch=7, config=CONFIG)


@pytest.mark.parametrize("batch", [1, 64])
def test_bits_do_not_depend_on_the_batch(reference, batch):
    pairs = PAIRS if batch > 1 else PAIRS[:16]
    for key, frames in run(pairs, batch=batch, config=CONFIG).items():
        assert frames.tobytes() == reference[key].tobytes(), key


def test_bits_of_the_papers_spawn_do_not_depend_on_the_batch():
    one, other = (run(PAIRS[:16], batch=batch, config=PAPER) for batch in (1, 16))
    assert digest(one) == digest(other)


def test_bits_do_not_depend_on_the_order_of_the_queue(reference):
    order = np.random.default_rng(1).permutation(len(PAIRS))
    found = run([PAIRS[i] for i in order], batch=5, config=CONFIG)
    assert found.keys() == reference.keys()
    assert digest(found) == digest(reference)


def test_a_run_that_starts_in_the_middle_of_the_queue_goes_on_with_the_same_bits(reference):
    found = run(PAIRS[40:], batch=9, config=CONFIG)
    assert digest(found) == digest({key: reference[key] for key in PAIRS[40:]})


def test_bits_do_not_depend_on_the_order_of_the_scenario_list(reference):
    # the record's `table` is the row of its scenario in that list: bookkeeping, not physics
    world = World(CONFIG, SCENARIOS[::-1], PAIRS, 16, 1)
    for key, frames in episodes(world).items():
        frames["table"] = reference[key]["table"]
        assert frames.tobytes() == reference[key].tobytes(), key


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


def test_seed_and_number_make_episodes_that_differ():
    starts = [run([(1, 0)], seed=1)[1, 0], run([(1, 0)], seed=2)[1, 0], run([(1, 1)], seed=1)[1, 1]]
    for a, b in itertools.combinations(starts, 2):
        assert a["vehicle_x"][0] != b["vehicle_x"][0] or a["vehicle_y"][0] != b["vehicle_y"][0]
        assert a["walking_speed"][0] != b["walking_speed"][0]
