"""A dataset made on a Dask cluster: a scheduler and two workers, processes on the loopback."""

from functools import partial
from pathlib import Path

import pytest
from extras.cluster.dask_cluster import local_cluster
from generate.small import TARGETS, UNIT

from vpsci_ros.generate.generate_dataset import generate, part_writers

cluster = pytest.importorskip("vpsci_ros.extras.cluster.cluster")
pytest.importorskip("distributed")


def test_two_workers_of_a_cluster_make_the_bytes_of_one_process(job, made: Path, tmp_path: Path) -> None:
    with local_cluster(tmp_path / "cluster") as local:
        site = cluster.DaskCluster(str(local.file))
        done = generate(
            job,
            TARGETS,
            tmp_path / "set",
            partial(part_writers, job, 64, site),
            unit=UNIT,
        )
        assert done.computed > 0
    names = sorted(path.name for path in made.iterdir() if path.name != "generation.json")
    assert names == sorted(path.name for path in (tmp_path / "set").iterdir() if path.name != "generation.json")
    assert all((made / name).read_bytes() == (tmp_path / "set" / name).read_bytes() for name in names if "." in name)
