"""What lies in the folder of a run beside its results, and which folders a run refuses."""

import json
import os
import signal
import time
from pathlib import Path

import pytest

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.documents import dump_yaml
from vpsci_ros.errors import InvalidInput, Stopped
from vpsci_ros.parameters import as_ros_parameters
from vpsci_ros.runs import run_folder
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.record import read_record
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.run_folder import RunFolder

SECTIONS = Sections({"learner": {"seed": 1, "episodes": 600, "near_misses": []}})


def test_the_parameters_are_there_before_the_run_and_the_record_after_it(tmp_path: Path) -> None:
    data, folder = tmp_path / "data.parquet", tmp_path / "out"
    data.write_bytes(b"near misses")
    with RunFolder(folder, SECTIONS, [data], {"study": 3}) as run:
        assert load(folder / "params.yaml").values["learner"] == {"seed": 1, "episodes": 600}
        assert not (folder / "run.json").exists()
        (folder / "result.csv").write_text("a\n")
        run.results["rows"] = 1
    record = json.loads((folder / "run.json").read_text())
    assert record["error"] == ""
    assert record["inputs_sha256"] == {str(data): sha256(data)}
    assert record["outputs_sha256"]["result.csv"] == sha256(folder / "result.csv")
    assert record["results"] == {"rows": 1}
    assert record["study"] == 3
    assert {"torch", "numpy", "vpsci_ros"} <= set(record["software"])


@pytest.mark.parametrize(("error", "said"), [(Stopped(), "stopped on request"), (ValueError("too hot"), "too hot")])
def test_a_run_that_does_not_reach_its_end_says_why(tmp_path: Path, error: Exception, said: str) -> None:
    with pytest.raises(type(error)), RunFolder(tmp_path / "out", SECTIONS):
        raise error
    assert json.loads((tmp_path / "out" / "run.json").read_text())["error"] == said


def test_a_folder_of_other_parameters_or_of_something_else_is_refused(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "out", SECTIONS):
        pass
    with RunFolder(tmp_path / "out", SECTIONS):
        pass
    other = SECTIONS.changed("learner", {"episodes": 5})
    with pytest.raises(InvalidInput, match=r"a run with learner.episodes = 600, and this one has 5; choose another"):
        RunFolder(tmp_path / "out", other)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "cat.jpg").write_bytes(b"")
    with pytest.raises(InvalidInput, match="the output folder is not empty"):
        RunFolder(tmp_path / "photos", SECTIONS)
    assert [path.name for path in (tmp_path / "photos").iterdir()] == ["cat.jpg"]


def test_a_command_goes_on_from_the_checkpoint_of_a_graph_and_refuses_a_graphs_folder_without_one(tmp_path) -> None:
    learner = SECTIONS.values["learner"] | {"peers": ["learner"]}
    graph = Sections({"graph": {"nodes": ["learner"]}, "learner": learner})
    (tmp_path / "params.yaml").write_text(dump_yaml(as_ros_parameters(graph.values)))
    with pytest.raises(InvalidInput, match=r"params.yaml: holds a run with graph = "):
        RunFolder(tmp_path, SECTIONS)
    (tmp_path / "checkpoint.safetensors").write_bytes(b"state")
    with RunFolder(tmp_path, SECTIONS) as run:
        assert not run.done
        assert load(tmp_path / "params.yaml").values["learner"] == {"seed": 1, "episodes": 600}, "without peers"


def test_a_folder_knows_whether_it_holds_this_run_finished_from_the_same_inputs(tmp_path: Path) -> None:
    data, folder = tmp_path / "data.parquet", tmp_path / "out"
    data.write_bytes(b"near misses")
    with pytest.raises(Stopped), RunFolder(folder, SECTIONS, [data]) as run:
        assert not run.done
        raise Stopped
    assert not RunFolder(folder, SECTIONS, [data]).done
    with RunFolder(folder, SECTIONS, [data]):
        pass
    assert RunFolder(folder, SECTIONS, [data]).done
    (folder / "weights").write_bytes(b"")
    with RunFolder(folder, SECTIONS, [data]):
        pass
    (folder / "weights").unlink()
    assert not RunFolder(folder, SECTIONS, [data]).done, "something that it left is gone"
    with RunFolder(folder, SECTIONS, [data]):
        pass
    data.write_bytes(b"more near misses")
    assert not RunFolder(folder, SECTIONS, [data]).done


def test_a_request_to_stop_waits_until_the_record_is_written(tmp_path, monkeypatch) -> None:
    def interrupted(path, **rest) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)  # a signal that were not held would raise here
        write_record(path, **rest)

    write_record = run_folder.write_record
    monkeypatch.setattr(run_folder, "write_record", interrupted)
    with pytest.raises(KeyboardInterrupt), RunFolder(tmp_path / "run", Sections({})) as run:
        run.results["done"] = 1
    assert read_record(tmp_path / "run" / "run.json")["results"] == {"done": 1}
