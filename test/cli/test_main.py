"""The command line as a stranger meets it: help without heavy imports, one line for an error, nothing half written."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import typer
from synthetic import synthetic_near_misses

from vpsci_ros.cli.main import app, main
from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.data.near_misses import read_near_misses, write_near_misses
from vpsci_ros.documents import OUTPUTS
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.resources import weights_path

ROOT = Path(__file__).resolve().parents[2]
PARAMS = ROOT / "params"


@pytest.fixture
def vpsci(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """The command in this process, with what it prints: to start Python and import torch takes seconds each time."""
    monkeypatch.chdir(ROOT)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        monkeypatch.setattr(sys, "argv", ["vpsci", *arguments])
        capfd.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        return subprocess.CompletedProcess(arguments, ended.value.code or 0, *capfd.readouterr())

    return run


def test_help_loads_neither_torch_nor_ros() -> None:
    code = "import sys, vpsci_ros.cli; print([m for m in ('torch', 'rclpy', 'numba', 'polars') if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert result.stdout.strip() == "[]", result.stderr


def test_the_command_is_a_program_with_help_and_an_exit_status() -> None:
    for arguments, status, said in ((["--help"], 0, "demo"), (["node", "pilot"], 2, "error: unknown node 'pilot'")):
        command = [sys.executable, "-m", "vpsci_ros.cli", *arguments]
        result = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, cwd=ROOT)
        assert result.returncode == status
        assert said in result.stdout + result.stderr


def test_a_command_with_closed_or_poor_streams_ends_with_its_status(tmp_path: Path) -> None:
    bag, ascii_only = tmp_path / os.fsdecode(b"\xff\xc3\xb6"), {**os.environ, "PYTHONIOENCODING": "ascii"}
    shutil.copytree(ROOT / "bags" / "LocationA_PedCross_E-W", bag)
    for streams, arguments, status, said in (
        ("<&- >&- 2>&-", ["--version"], 0, b""),
        ("2>&-", ["bag", "info", "nowhere"], 2, b""),
        (">/dev/full", ["--version"], 1, b"error: No space left on device"),
        ("", ["export", str(bag), "--to", "lanelet2", "-o", f"{bag}-out"], 0, b"\\udcff\\xf6-out/lanelet2, "),
        ("", ["bag", "info", f"{bag}/x"], 2, b"\\udcff\\xf6/x: no such folder"),
    ):
        command = ["sh", "-c", f'exec "$@" {streams}', "sh", sys.executable, "-m", "vpsci_ros.cli", *arguments]
        ended = subprocess.run(command, capture_output=True, timeout=120, check=False, cwd=ROOT, env=ascii_only)
        assert ended.returncode == status, (arguments, ended.stderr)
        assert said in ended.stdout + ended.stderr
        assert b"Traceback" not in ended.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["import", "nowhere", "--format", "vci-dut", "-o", "x.parquet"], "nowhere"),
        (["import", "test", "--format", "vci", "-o", "x.parquet"], "unknown format 'vci'"),
        (["import", "test", "--format", "described", "-o", "x.csv"], "-o x.csv: a table of near misses is Parquet"),
        (
            ["graph", "--params", "none.yaml", "-o", "x"],
            "none.yaml: no such parameter file; the package's own are ads_test",
        ),
        (
            ["graph", "--params", "params/stage3_generate.yaml", "-o", "x", "--set", "learner.sed=1"],
            "did you mean seed",
        ),
        (
            ["ads-test", "-o", "x", "--set", "ads_test.episodes=3"],
            "ads_test has no parameter episodes; expected world_simulator.episodes; or give --episodes N",
        ),
        (["bag", "export", "nowhere", "-o", "x"], "nowhere: no such folder"),
        (["demo", "-o", "vpsci_ros"], "not empty: it holds __init__.py, "),
        (["pretrain", "--params", "params/stage2_online.yaml", "-o", "x"], "learner.stage = refine: expected pretrain"),
        (
            ["generate", "--params", "params/stage3_generate.yaml", "-o", "x", "--scenarios", "1,A"],
            "--scenarios 1,A: expected numbers",
        ),
        (["people", "right_turns", "--without", "cqut-pvi/dv", "-o", "x.safetensors"], "--without cqut-pvi/dv: no cl"),
        (["pretrain", "-o", "x", "--set", "learner.held_out_clips=[cqut-pvi/dv]"], "clips = cqut-pvi/dv: no clip"),
        (
            ["study", "models", "--params", "stage1_pretrain", "-o", "x", "--set", "learner.held_out_clips=[vci/]"],
            "held_out_clips = vci/: ",
        ),
        (["study", "models", "--params", "stage1_pretrain", "-o", "x", "--models", "sst,,lstm"], "'sst,,lstm': expect"),
        (["export", "right_turns/dev", "--to", "osi", "-o", "x", "--episodes", ","], "--episodes ',': expected names"),
        (["view", "right_turns/dev", "--episode", "9999999", "-o", "x.html"], "no episode 9999999; it has "),
        (["world", "show", "1", "-o", "docs"], "expected a file to write, found a folder"),
    ],
)
def test_an_error_is_one_line_that_says_what_and_where(
    vpsci: Callable[..., subprocess.CompletedProcess[str]], arguments: list[str], message: str
) -> None:
    result = vpsci(*arguments)
    assert result.returncode == 2
    assert message in result.stderr
    said = [line for line in result.stderr.splitlines() if not line.startswith("  ")]  # but for what it begins with
    assert len(said) == 1
    assert said[0].startswith("error: ")
    assert not any((ROOT / name).exists() for name in ("x", "x.parquet", "x.png", "x.html", "x.safetensors"))


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (["--format", "wrong"], "unknown format 'wrong'"),
        (["--format", "described", "--format", "levelx"], "expected one format for each folder"),
        (["--format", "described", "--kinds", "walkers"], "--kinds walkers: expected"),
        (["--format", "described", "--frame-rate", "10"], "--frame-rate: files of format described say"),
        (["--format", "described", "--name", "a/b"], "--name 'a/b': expected letters"),
    ],
)
def test_an_import_refuses_an_option_before_it_says_that_it_begins(
    vpsci: Callable[..., subprocess.CompletedProcess[str]], option: list[str], message: str
) -> None:
    refused = vpsci("import", "test", "-o", "x.parquet", *option)
    assert refused.returncode == 2
    assert refused.stderr.startswith(f"error: {message}")


def test_every_option_that_names_an_output_file_refuses_a_pipe_before_the_work(
    vpsci: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for arguments in (
        ["import", "nowhere", "--format", "described", "-o"],
        ["people", "nowhere", "-o"],
        ["world", "show", "1", "-o"],
        ["view", "nowhere", "-o"],
        ["evaluate", "--data", "nowhere", "--json"],
        ["realism", "--data", "nowhere", "--json"],
    ):
        result = vpsci(*arguments, str(pipe))
        assert result.returncode == 2, arguments
        assert result.stderr.startswith(f"error: {pipe}: expected a file to write, found a pipe, a device or")
    assert pipe.is_fifo()


def test_an_output_that_is_an_input_is_refused_before_the_work_by_whatever_path(
    vpsci: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    table, bank, scenario, bag, data = (tmp_path / n for n in ("t.parquet", "p.safetensors", "s.yaml", "bag", "data"))
    write_near_misses(synthetic_near_misses(4).table, table)
    shutil.copy(weights_path("people"), bank)
    shutil.copy(PARAMS / "scenarios" / "LocationA_PedCross_E-W.yaml", scenario)
    shutil.copytree(ROOT / "bags" / "LocationA_PedCross_E-W", bag)
    with DatasetWriter(data, {}, {"period": 0.05}) as writer:
        writer.close(datasheet=lambda _: "of this dataset")
    link, hard, tensors = (tmp_path / name for name in ("link.parquet", "hard.parquet", "hard.safetensors"))
    link.symlink_to(table)
    hard.hardlink_to(table)
    tensors.hardlink_to(table)
    mcap = next(bag.glob("*.mcap"))
    for output, arguments in (
        (table, ["view", str(table), "-o"]),
        (link, ["view", str(table), "-o"]),
        (table, ["view", str(hard), "-o"]),
        (Path(os.path.relpath(table, ROOT)), ["view", str(link), "-o"]),
        (mcap, ["view", str(bag), "-o"]),
        (bag / "metadata.yaml", ["view", str(bag), "-o"]),
        (data / "README.md", ["view", str(data), "-o"]),
        (scenario, ["world", "show", str(scenario), "-o"]),
        (tensors, ["people", str(table), "-o"]),
        (table, ["evaluate", "--data", str(table), "--json"]),
        (bank, ["evaluate", "--data", str(table), "--weights", f"own={bank}", "--json"]),
        (table, ["realism", "--data", str(table), "--json"]),
        (table, ["realism", "--data", "right_turns/dev", "--library", str(hard), "--json"]),
    ):
        files = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
        result = vpsci(*arguments, str(output))
        assert (result.returncode, "would replace an input" in result.stderr) == (2, True), (arguments, result.stderr)
        assert output.name in result.stderr
        assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == files
    assert not OUTPUTS
    for arguments in (
        ["pretrain", "--params", str(scenario)],
        ["refine", "--set", f"learner.weights={bank}"],
        ["ads-test", "--baseline", str(tmp_path)],
        ["turing", "score", str(bag / "key.json"), str(table)],
        ["dataset", "merge", "nowhere", str(data)],
    ):
        result = vpsci(*arguments, "-o", str(tmp_path))
        assert f"error: -o {tmp_path}: the output would replace an input, {tmp_path}" in result.stderr, arguments


def test_every_option_that_names_an_output_is_checked() -> None:
    def of(command: Any) -> Iterator[Any]:
        for child in getattr(command, "commands", {}).values():
            yield from of(child)
        if not hasattr(command, "commands"):
            yield command

    group: Any = typer.main.get_command(app)
    outputs = [
        (command, option)
        for name in group.list_commands(None)
        for command in of(group.get_command(None, name))
        for option in command.params
        if {"-o", "--json"} & set(option.opts) and not option.is_flag
    ]
    files = [option for _, option in outputs if "older" not in option.help]
    folders = [command for command, option in outputs if "older" in option.help]
    assert len(files) == 8
    assert len(folders) >= 20
    assert all(option.callback is not None for option in files)
    assert all(hasattr(command.callback, "__wrapped__") for command in folders if command.name != "report")


@pytest.mark.parametrize("path", sorted(PARAMS.glob("*.yaml")), ids=lambda path: path.name)
def test_every_parameter_file_of_the_package_is_accepted(path: Path) -> None:
    from vpsci_ros.cli.parameter_file import load, stage_of
    from vpsci_ros.parameters import read_parameter_file

    sections, kinds = load(path), stage_of(read_parameter_file(path)).sections
    assert all(sections.get(kind, node) for node in sections.values for kind in kinds[node])


def test_pretraining_writes_weights_that_evaluation_reads(
    vpsci: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    small = [f"learner.{name}" for name in ("episodes=2", "replay.batch_size=16", "hidden=16")]
    table = synthetic_near_misses(24).table
    write_near_misses(table, tmp_path / "all.parquet")
    write_near_misses(table.filter(pl.col("interaction") < 8), tmp_path / "near.parquet")
    settings = [argument for text in small for argument in ("--set", text)]
    stage = ["--params", str(PARAMS / "stage1_pretrain.yaml"), "--near-misses", str(tmp_path / "all.parquet")]
    run = vpsci("pretrain", *stage, "-o", str(tmp_path / "run"), *settings)
    assert run.returncode == 0, run.stderr
    weights = str(tmp_path / "run" / "pretrained.safetensors")

    arguments = ["--data", str(tmp_path / "near.parquet"), "--json", str(tmp_path / "out.json")]
    result = vpsci("evaluate", *arguments, "--weights", f"own={weights}")
    assert result.returncode == 0, result.stderr
    models = json.loads((tmp_path / "out.json").read_text())["models"]
    assert set(models) == {
        "own",
        "people",
        "closed_loop",
        "ma_sst_ddpg",
        "repeat_velocity",
        "constant_velocity",
        "constant_velocity_tracked",
        "fading_acceleration",
        "residual_sampler",
    }
    assert models["own"]["closed_loop"]["ade"] > 0
    assert pl.read_csv(tmp_path / "run" / "log.csv").height == 2

    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert record["error"] == ""
    assert set(record["outputs_sha256"]) == {"log.csv", "learning.png", "params.yaml", "pretrained.safetensors"}
    made_from = json.loads((tmp_path / "out.json").read_text())["weights_sha256"]
    assert made_from["own"] == record["outputs_sha256"]["pretrained.safetensors"]
    assert list(record["inputs_sha256"]) == [str(tmp_path / "all.parquet")]
    before = (tmp_path / "run" / "log.csv").stat().st_mtime_ns
    same = vpsci("pretrain", *stage, "-o", str(tmp_path / "run"), *settings)
    assert (same.returncode, "holds this run, finished" in same.stdout) == (0, True)
    assert (tmp_path / "run" / "log.csv").stat().st_mtime_ns == before

    again = vpsci("pretrain", *stage, "-o", str(tmp_path / "run"))
    assert again.returncode == 2
    assert "holds a run with learner.episodes = 2, and this one has 400" in again.stderr


def test_held_out_rows_of_policies_that_may_have_learned_from_the_clips_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from vpsci_ros.cli.evaluation import run_evaluation

    table, own = read_near_misses("right_turns"), load_policy("closed_loop")
    left_out = own.facts["data"]["held_out_clips"][:3]
    part = table.filter(pl.concat_str("source", "clip", separator="/").is_in(left_out))
    write_near_misses(part, tmp_path / "part.parquet")
    run_evaluation(tmp_path / "part.parquet", "near-misses", ["closed_loop"], None, held_out=True)
    notes = [line for line in capsys.readouterr().out.splitlines() if line.startswith("note: ")]
    assert notes == ["note: people may have learned from 3 of these 3 clips, so its row is not held out"]


@pytest.mark.parametrize(("error", "status"), [("", 0), ("3 answers of vehicle_policy are missing", 1)])
def test_a_graph_that_is_not_complete_ends_the_command_with_1(
    error: str, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from vpsci_ros.nodes import graph

    monkeypatch.setattr(graph, "run_graph", lambda _, folder, **__: graph.GraphResult(folder, error))
    monkeypatch.setattr(sys, "argv", ["vpsci", "graph", "--params", "stage3_generate", "-o", str(tmp_path / "run")])
    monkeypatch.chdir(ROOT)
    ended = 0
    try:
        main()
    except SystemExit as exits:
        ended = int(exits.code or 0)
    assert ended == status
    assert capsys.readouterr().err.startswith(f"error: {error};" if error else "")


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (MemoryError(), 1),
        (ImportError("libarrow.so: failed to map segment from shared object"), 1),
        (ModuleNotFoundError("No module named 'torch'", name="torch"), 2),
    ],
)
def test_what_cannot_be_loaded_for_want_of_memory_has_failed_and_what_is_not_installed_is_refused(
    vpsci: Callable[..., subprocess.CompletedProcess[str]],
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
    status: int,
) -> None:
    def fail() -> None:
        raise error

    monkeypatch.setattr("vpsci_ros.cli.main.app", fail)
    assert vpsci("graph").returncode == status


def test_a_command_that_is_terminated_leaves_its_record_and_ends_as_by_ctrl_c(tmp_path: Path) -> None:
    code = """
import sys, time
from pathlib import Path
from vpsci_ros.cli import main
from vpsci_ros.runs.run_folder import RunFolder
from vpsci_ros.runs.run_config import Sections
def work():
    with RunFolder(Path(sys.argv[1]), Sections({})):
        print("begun", flush=True)
        time.sleep(600.0)
main.app = work
main.main()
"""
    with subprocess.Popen([sys.executable, "-c", code, tmp_path], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        process.terminate()
    assert process.returncode == 130
    assert json.loads((tmp_path / "run.json").read_text())["error"] == "stopped on request"


def test_a_graph_that_is_stopped_ends_with_130_and_one_that_fails_with_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["vpsci", "graph", "--params", "stage3_generate", "-o", str(tmp_path / "out")])
    graph = pytest.importorskip("vpsci_ros.nodes.graph")
    for error, status in (("stopped on request", 130), ("a node died", 1)):
        monkeypatch.setattr(graph, "run_graph", lambda *_, error=error, **__: graph.GraphResult(tmp_path, error))
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == status
        assert f"{error}; what was written up to then is in" in capsys.readouterr().err
