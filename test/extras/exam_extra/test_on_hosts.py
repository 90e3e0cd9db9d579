"""An exam on the hosts of a Ray cluster: the report of one process, and no host drives something else."""

import os
from functools import partial
from pathlib import Path

import pytest
from exam.test_parts import EXAMPLE, report_of, small

from vpsci_ros.errors import VpsciError
from vpsci_ros.exam import exam as exam_module
from vpsci_ros.exam.conduct import Run, conductor, run_with
from vpsci_ros.exam.prepare import identity_of, take_folder
from vpsci_ros.exam.run import run_exam
from vpsci_ros.extras.exam_extra.on_hosts import elsewhere, files_needed, hosts_crew, unpack


def test_a_run_that_was_driven_on_a_host_is_read_here_as_if_it_had_been_driven_here(tmp_path: Path) -> None:
    exam = small(pedestrians=["walker"])
    here, there = tmp_path / "here", tmp_path / "there"
    there.mkdir()
    driven = run_with(exam, "walker", here, "", quiet=True)
    unpack(elsewhere(partial(conductor, [exam], {}), exam, files_needed(exam))(Run("walker", 0)), there)
    assert not [path for path in there.iterdir() if path.name not in ("runs", "logs")]
    (there / "logs").rename(there / "none")  # a run that is driven once more would need it
    brought = run_with(exam, "walker", there, "", quiet=True)
    assert [each.key for each in brought.episodes] == [each.key for each in driven.episodes]
    assert all((a.speed == b.speed).all() for a, b in zip(brought.episodes, driven.episodes, strict=True))


def test_a_host_with_another_driving_system_refuses_and_names_the_file() -> None:
    exam = small()
    needed = files_needed(exam) | {"example_driver.py": 64 * "0"}
    with pytest.raises(VpsciError, match="has other files than the machine of the exam: example_driver.py; install"):
        elsewhere(partial(conductor, [exam], {}), exam, needed)


@pytest.mark.filterwarnings("ignore")  # Ray's own
@pytest.mark.timeout(1500)  # kernels and a cluster that starts: a minute of CPU time, long on a busy machine
def test_a_cluster_gives_the_report_of_one_process_and_goes_on_where_it_was_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ray", reason="needs Ray: pip install 'vpsci_ros[ray]'")
    os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_worker_niceness": "0"}  # Ray's own choice is 15
    assert run_exam(small(EXAMPLE), tmp_path / "one", quiet=True) == []
    monkeypatch.setattr(exam_module, "SIDE_BY_SIDE", 4)
    two = tmp_path / "two"
    take_folder(two, identity_of(small()))
    run_with(small().parts()[0], "walker", two, "", quiet=True)  # what was driven before
    before = (two / "runs/walker/run.json").stat().st_mtime_ns
    assert run_exam(small(EXAMPLE), two, workers=2, crew=hosts_crew(small(EXAMPLE), "local"), quiet=True) == []
    assert report_of(two) == report_of(tmp_path / "one")
    assert (two / "runs/walker/run.json").stat().st_mtime_ns == before
