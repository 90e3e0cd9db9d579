import polars as pl
import pytest
from learning.test_refine import QUICK, experience

from vpsci_ros.learning.refine import Refiner
from vpsci_ros.learning.refine_log import EPISODES_A_ROW, RefineLog


@pytest.fixture
def refiner(networks, near_misses):
    return Refiner(QUICK, networks(gain=1.0).weights({}, {}), near_misses, seed=4)


def add(refiner, histories):
    refiner.add(experience(histories, first_number=refiner.progress.received, first_episode=refiner.progress.episodes))


def test_logs_grow_while_the_learner_learns_and_miss_no_episode_at_the_end(tmp_path, refiner):
    log = RefineLog(refiner, tmp_path / "learner")
    log.note()
    add(refiner, EPISODES_A_ROW - 1)
    log.note()
    assert not (tmp_path / "learner").exists(), "nothing to tell yet"
    add(refiner, 1)
    log.note()
    assert pl.read_csv(tmp_path / "learner" / "refine_log.csv")["episodes"].to_list() == [EPISODES_A_ROW]
    add(refiner, 3)
    log.note()
    log.note(last=True)
    log.note(last=True)
    rows = pl.read_csv(tmp_path / "learner" / "refine_log.csv")
    assert rows["episodes"].to_list() == [EPISODES_A_ROW, EPISODES_A_ROW + 3]
    rewards = pl.read_csv(tmp_path / "learner" / "refine_episodes.csv")
    assert rewards["episode"].to_list() == list(range(1, EPISODES_A_ROW + 4))
    assert (rewards["vehicle"] < 0.0).any()
