"""A dataset's bytes depend on what it is made from, not on who made it, how often it was stopped, in what pieces."""

import dataclasses
import errno
import multiprocessing
import os
import shutil
import signal
from functools import partial
from multiprocessing import connection
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from generate.small import TARGETS, UNIT

from vpsci_ros.data.dataset_description import DESCRIPTION
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.generate.generate_dataset import generate, part_writers, simulators
from vpsci_ros.generate.job import Unit, job_from
from vpsci_ros.generate.parts import FINISHED, FOLDER, Parts
from vpsci_ros.generate.plan import DatasetPlan
from vpsci_ros.generate.simulate import Simulator, storing
from vpsci_ros.generate.verify import repeated
from vpsci_ros.runs.files import atomic_write, sha256
from vpsci_ros.runs.workers import Place, Processes, Serial, ThisMachine


def hashes(folder: Path) -> dict[str, str]:
    """Return the hash of every file that is part of the dataset."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != FINISHED]
    return {path.relative_to(folder).as_posix(): sha256(path) for path in files}


class Stopped(Serial):
    """Stopped by Ctrl-C after `left` units."""

    left = 2

    def collect(self):
        if self.left == 0:
            raise KeyboardInterrupt
        self.left -= 1
        return super().collect()


def test_the_last_episode_of_each_scenario_is_the_last_kept_one_wanted(made) -> None:
    index = Dataset(made).index()
    for (scenario,), rows in index.group_by("scenario"):
        assert (rows["reason"] == "kept").sum() == TARGETS[scenario]
        assert rows.sort("count")["reason"][-1] == "kept"
        assert rows["count"].sort().to_list() == list(range(len(rows)))


@pytest.mark.parametrize("damage", ["emptied", "changed in one byte", "gone"])
def test_a_finished_dataset_that_lost_something_is_not_said_to_be_there(make, made, tmp_path, damage: str) -> None:
    folder = shutil.copytree(made, tmp_path / "d")
    make(folder)  # is whole, so that nothing is to be done
    victim = next(folder.glob("Location*.parquet"))
    data = victim.read_bytes()
    victim.write_bytes(b"" if damage == "emptied" else bytes([data[0] ^ 1]) + data[1:])
    if damage == "gone":
        victim.unlink()
    with pytest.raises(InvalidInput, match=f"the dataset was finished, and {victim.name} is missing or changed since"):
        make(folder)


def job_in(parts, job, batch: int):
    return partial(storing, job, batch, parts, Place(parts.folder))


def test_a_run_that_was_stopped_goes_on_and_gives_the_same_bytes(job, make, made, tmp_path) -> None:
    with pytest.raises(KeyboardInterrupt):
        generate(job, TARGETS, tmp_path / "d", lambda parts: Stopped(job_in(parts, job, 64)), unit=UNIT)
    assert [path.name for path in (tmp_path / "d").iterdir()] == [FOLDER]
    assert len(list((tmp_path / "d" / FOLDER).glob("*.block"))) == 2
    resumed = make(tmp_path / "d", unit=1000)  # goes on in the units of old
    assert resumed.computed == make(tmp_path / "once").computed - 2 * UNIT
    assert hashes(tmp_path / "d") == hashes(made)


def test_a_run_that_ended_between_its_last_file_and_its_record_writes_the_record_next_time(
    make, made, tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr("vpsci_ros.generate.generate_dataset.write_record", killed)
        make(tmp_path / "d")
    assert (tmp_path / "d" / DESCRIPTION).is_file()
    assert make(tmp_path / "d").computed == 0
    assert (tmp_path / "d" / FINISHED).is_file()
    assert hashes(tmp_path / "d") == hashes(made)


def test_a_unit_that_the_disk_has_damaged_is_computed_again(job, make, made, tmp_path) -> None:
    with pytest.raises(KeyboardInterrupt):
        generate(job, TARGETS, tmp_path / "d", lambda parts: Stopped(job_in(parts, job, 64)), unit=UNIT)
    part = next((tmp_path / "d" / FOLDER).glob("*.block"))
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    part.write_bytes(data)
    make(tmp_path / "d")
    assert hashes(tmp_path / "d") == hashes(made)


def test_a_part_holds_its_block_to_the_bit_and_tells_any_damage(job, tmp_path) -> None:
    unit, parts = Unit(1, range(8)), Parts(tmp_path, 8, "run 1")
    block, path = Simulator(job, 8)(unit), parts.path(unit)
    assert parts.load(unit) is None
    parts.write(unit, block)
    found = parts.load(unit)
    assert found.records.tobytes() == block.records.tobytes()
    assert found.values.tobytes() == block.values.tobytes()
    whole = path.read_bytes()
    assert Parts(tmp_path, 8, "run 2").load(unit) is None
    flipped = [whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :] for at in (0, 4, len(whole) // 2, len(whole) - 1)]
    for damaged in (b"", whole[:3], whole[:4], whole[:-1], whole + b"0", *flipped):
        path.write_bytes(damaged)
        assert parts.load(unit) is None


def test_parts_of_other_units_and_runs_and_other_files_are_named_and_not_used(
    job, make, made, tmp_path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "d"
    with pytest.raises(KeyboardInterrupt):
        generate(job, TARGETS, folder, lambda parts: Stopped(job_in(parts, job, 64)), unit=UNIT)
    first, *_ = sorted((folder / FOLDER).glob("*.block"))
    shutil.copyfile(first, folder / FOLDER / "1-0000000003.block")  # begins no unit
    shutil.copyfile(first, folder / FOLDER / f"6-{10 * UNIT:010d}.block")  # of another unit
    (folder / FOLDER / "notes.txt").touch()
    (folder / FOLDER / "run.json").unlink()
    make(folder, unit=UNIT)
    assert hashes(folder) == hashes(made)
    said = capsys.readouterr().err
    for name in ("1-0000000003.block", f"6-{10 * UNIT:010d}.block", "notes.txt"):
        assert f"{name} is damaged or no part of this run" in said


def test_files_read_together_join_the_index_and_no_two_agents_share_an_id(made) -> None:
    rows = pl.read_parquet(made / "Location*.parquet")
    kept = Dataset(made).index().filter(pl.col("reason") == "kept")
    joined = rows.join(kept, on=["scenario", "count"], suffix="_index")
    assert joined.height == rows.height == kept["frames"].sum()
    ids = set(rows["veh_id"].unique()) | set(rows["ped_id"].unique())
    assert len(ids) == 2 * kept.height


def test_a_finished_dataset_is_extended_to_the_bytes_of_a_larger_one(job, make, made, tmp_path) -> None:
    folder, fewer = tmp_path / "d", dict.fromkeys(TARGETS, 7)
    start = partial(part_writers, job, 40, ThisMachine())
    generate(job, fewer, folder, start, unit=UNIT)
    done = generate(job, TARGETS, folder, start, unit=UNIT)
    assert hashes(folder) == hashes(made)
    assert done.computed < make(tmp_path / "once").computed
    with pytest.raises(InvalidInput, match=r"holds a dataset with kept_wanted\.1 = 12, and this one has 7"):
        generate(job, fewer, folder, start, unit=UNIT)


def test_a_dataset_is_generated_again_from_its_description(made, tmp_path) -> None:
    job, targets, first, formats = repeated(made / DESCRIPTION)
    start = partial(part_writers, job, 40, ThisMachine())
    generate(job, targets, tmp_path / "e", start, unit=UNIT, first=first, formats=formats)
    assert hashes(tmp_path / "e") == hashes(made)


def test_two_processes_of_which_one_is_killed_and_other_units_and_batches_give_the_same_bytes(
    job, made, tmp_path
) -> None:
    class Murdered(Processes):
        victims = 1

        def collect(self):
            found = super().collect()
            if self.victims:
                self.victims -= 1
                os.kill(next(iter(self._processes.values())).pid, signal.SIGKILL)
            return found

    generate(job, TARGETS, tmp_path / "d", lambda parts: Murdered(job_in(parts, job, 8), 2), unit=21)
    assert hashes(tmp_path / "d") == hashes(made)


def test_a_worker_killed_while_it_writes_a_result_costs_nothing_but_time(job, monkeypatch) -> None:
    unit, killed = Unit(1, range(300)), []
    workers = simulators(job, 64, 2)

    def wait(connections):
        ready = connection.wait(connections)
        for one in ready:
            if (
                workers._running.get(one) is not None and not killed
            ):  # it waits to write what does not fit into the pipe
                killed.append(workers._processes[one].pid)
                os.kill(killed[0], signal.SIGKILL)
        return ready

    monkeypatch.setattr("vpsci_ros.runs.workers.wait", wait)
    workers.submit(unit)
    ((found, block),) = workers.collect()
    workers.close()
    assert len(killed) == 1
    assert found == unit
    assert block.values.nbytes > 1_000_000, "more than a pipe takes at once"
    here = Simulator(job, 64)(unit)
    assert (block.records.tobytes(), block.values.tobytes()) == (here.records.tobytes(), here.values.tobytes())


def test_an_error_in_a_worker_is_raised_here(job) -> None:
    workers = Processes(partial(Simulator, job, 8), 1)
    workers.submit(Unit(99, range(8)))
    with pytest.raises(InvalidInput, match="scenario 99"):
        workers.collect()
    workers.close()
    assert not multiprocessing.active_children()


def test_another_configuration_is_refused_naming_what_differs(job, make, made, tmp_path) -> None:
    other = dataclasses.replace(job, seed=4)
    with pytest.raises(InvalidInput, match="holds a dataset with seed = 3, and this one has 4"):
        make(made, of=other)
    with pytest.raises(KeyboardInterrupt):
        generate(job, TARGETS, tmp_path / "d", lambda parts: Stopped(job_in(parts, job, 64)), unit=UNIT)
    world = dataclasses.replace(job.world, release_time=0.5)
    with pytest.raises(InvalidInput, match=r"unfinished run with .*release_time = 5\.0, and this one has 0\.5"):
        make(tmp_path / "d", of=dataclasses.replace(job, world=world))


@pytest.mark.parametrize(("name", "value"), [("only", [1, 17]), ("episode_changes", "exam.json")])
def test_what_chooses_or_changes_single_episodes_is_refused(sections, name: str, value: object) -> None:
    with pytest.raises(InvalidInput, match=f"world_simulator.{name}: .*take it out"):
        job_from(sections.changed("world_simulator", {name: value}))


def test_another_kind_of_cpu_or_other_versions_do_not_mix_into_a_folder(make, made, monkeypatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("vpsci_ros.generate.job.cpu_name", lambda: "Another CPU")
        with pytest.raises(InvalidInput, match="and this one has 'Another CPU'"):
            make(made)
    monkeypatch.setattr("vpsci_ros.generate.generate_dataset.software_versions", lambda: {"numpy": "0.1"})
    with pytest.raises(InvalidInput, match=r"holds a dataset with versions\."):
        make(made)


def test_a_full_disk_ends_the_run_with_what_to_do_and_loses_nothing(job, make, made, tmp_path, monkeypatch) -> None:
    def full(path: Path):
        if len(list(path.parent.glob("1-*.block"))) == 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return atomic_write(path)

    monkeypatch.setattr("vpsci_ros.runs.journal.atomic_write", full)
    with pytest.raises(VpsciError, match=r"cannot write \(No space left on device\); .* the same command"):
        generate(job, TARGETS, tmp_path / "d", lambda parts: Serial(job_in(parts, job, 64)), unit=UNIT)
    monkeypatch.undo()
    make(tmp_path / "d")
    assert hashes(tmp_path / "d") == hashes(made)


def test_hopeless_filters_end_the_run_with_the_reason(job, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("vpsci_ros.generate.generate_dataset.DatasetPlan", partial(DatasetPlan, give_up=1.0))
    strict = dataclasses.replace(job, filters=dataclasses.replace(job.filters, vehicle_distance=1000.0))
    with pytest.raises(VpsciError, match=r"0 of \d+ episodes passed the filters, 12 are wanted"):
        generate(strict, TARGETS, tmp_path, partial(part_writers, strict, 64, ThisMachine()), unit=UNIT)


def test_counts_add_up(made) -> None:
    data = Dataset(made)
    index = data.index()
    for name, counts in data.scenarios.items():
        mine = index.filter(pl.col("scenario") == counts["number"])
        assert counts["simulated"] == len(mine) == counts["kept"] + sum(counts["rejected"].values())
        assert sum(counts["outcomes"].values()) == len(mine)
        rejected = pl.read_parquet(made / "rejected" / f"{name}.parquet")
        assert rejected["count"].n_unique() == len(mine) - counts["kept"]
        kept = mine.filter(pl.col("reason") == "kept")["least_curvttc"].to_numpy()
        assert counts["least_curvttc"] == pytest.approx(np.quantile(kept, (0.25, 0.5, 0.75)), abs=1e-4)
