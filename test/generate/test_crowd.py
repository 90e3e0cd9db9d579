"""A dataset of episodes with several pedestrians: rows of each, filtered by one pair, and verified to the bit."""

from functools import partial
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from bags.collected import collected
from generate.small import NETWORK, UNIT

from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.dataset_tables import NEXT_PEDESTRIAN, NEXT_SCENARIO
from vpsci_ros.generate.bag import record_episodes
from vpsci_ros.generate.generate_dataset import generate, part_writers, simulators
from vpsci_ros.generate.job import job_from
from vpsci_ros.generate.verify import verify
from vpsci_ros.learning.networks import Networks
from vpsci_ros.policy.weights import save_weights
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.workers import ThisMachine

NAME = "LocationA_PedCross_S-N"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("crowd")
    weights = folder / "small.safetensors"
    save_weights(weights, Networks(NETWORK).weights({}, {}))
    world = {"scenarios": [1], "pedestrians": 3, "crowd.sizes": [1.0, 1.0, 2.0], "kinds.child": 0.3}
    policy = {"weights": str(weights)}
    dataset = {"keep_rejected": True}
    sections = Sections(
        {"world_simulator": world, "vehicle_policy": policy, "pedestrian_policy": policy, "dataset": dataset}
    )
    job = job_from(sections)
    generate(job, {1: 12}, folder / "dataset", partial(part_writers, job, 40, ThisMachine()), unit=UNIT)
    return folder / "dataset"


def test_rows_of_each_pedestrian_follow_each_other_under_a_name_of_its_own(made: Path) -> None:
    rows = Dataset(made).rows(NAME)
    assert (rows["veh_id"] == NEXT_SCENARIO * rows["scenario"].cast(pl.Int64) + 2 * rows["count"]).all()
    number = (rows["ped_id"] % NEXT_SCENARIO // NEXT_PEDESTRIAN).to_numpy()
    assert set(number.tolist()) == {0, 1, 2}
    assert (rows["ped_id"] % NEXT_PEDESTRIAN == 2 * rows["count"] + 1).all()
    assert rows.group_by("count").agg(pl.col("ped_id").n_unique())["count"].n_unique() == 12
    lengths = rows.group_by("count", "ped_id").len().group_by("count").agg(pl.col("len").n_unique())
    assert lengths["len"].to_list() == [1] * 12
    vehicle = [name for name in rows.columns if name.endswith("_av")]
    same = rows.group_by("count", "frame").agg(pl.col(vehicle).n_unique())
    assert (same.select(vehicle) == 1).to_numpy().all()


def test_an_episode_is_kept_with_all_of_its_pedestrians_when_one_pair_passes(made: Path) -> None:
    index = Dataset(made).index().filter(scenario=1)
    least = dict(zip(index["count"], index["least_curvttc"], strict=True))
    data = Dataset(made)
    for one in data.read(scenario=NAME):
        ttc = np.nanmin(one.curvttc)
        assert ttc == pytest.approx(least[one.number])
        assert ttc < 5.0


def test_the_dataset_is_simulated_again_to_the_bit_and_so_is_a_bag_of_it(made: Path, tmp_path: Path) -> None:
    assert verify(made, lambda job: simulators(job, 7, 1)).findings == []
    chosen = [(1, int(count)) for count in Dataset(made).index()["count"].head(3)]
    record_episodes(made, chosen, tmp_path / "bag")
    result = verify_bag(tmp_path / "bag", weights=str(next(made.glob("*.safetensors"))))
    assert (result.difference, result.notes) == ("", ())
    sizes = [int(block.records["pedestrians"][0]) for block in collected(tmp_path / "bag")]
    assert len(sizes) == 3
    assert max(sizes) > 1
