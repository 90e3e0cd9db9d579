"""A Ray cluster of two nodes gives the bytes that one process gives, also when a node dies."""

import os
from functools import partial
from pathlib import Path

import pytest
from generate.small import TARGETS, UNIT

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.errors import InvalidInput
from vpsci_ros.generate.run import generate
from vpsci_ros.generate.simulate import computing


def test_without_ray_its_option_says_what_to_install(job) -> None:
    from vpsci_ros.runs.ray_workers import RayWorkers

    try:
        import ray  # noqa: F401 - is it there?
    except ImportError:
        with pytest.raises(InvalidInput, match=r"pip install 'vpsci_ros\[ray\]'"):
            RayWorkers(partial(computing, job, 8), "local", 1)
    else:
        pytest.skip("Ray is installed here")


@pytest.mark.filterwarnings("ignore")  # Ray's own
def test_a_cluster_of_two_nodes_gives_the_same_bytes_though_one_of_them_dies(job, made, tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="needs Ray: pip install 'vpsci_ros[ray]'")
    from ray.cluster_utils import Cluster

    from vpsci_ros.runs.ray_workers import RayWorkers

    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    other = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()

    class OneDies(RayWorkers):
        alive = True

        def collect(self):
            found = super().collect()
            if self.alive:
                cluster.remove_node(other, allow_graceful=False)
                self.alive = False
            return found

    workers = partial(OneDies, partial(computing, job, 8), cluster.address, 2)
    generate(job, TARGETS, tmp_path / "d", workers, unit=UNIT)
    cluster.shutdown()
    assert Dataset(tmp_path / "d").description == Dataset(made).description
