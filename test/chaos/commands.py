"""Every command that writes, as small as it does what it does, for the campaigns that take something away from one.

`{out}` is what it writes, a file where an ending follows and a folder otherwise; the other names are of `inputs`.
"""

import contextlib
import io
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from synthetic import synthetic_near_misses

from vpsci_ros.cli.main import main
from vpsci_ros.data.near_misses import write_near_misses

ROOT = Path(__file__).parents[2]
PATIENCE = 900.0  # [s] for a command, on a loaded machine
_BAG = "bags/LocationA_PedCross_N-S"
_RULES = "--set world_simulator.vehicle_driver=autopilot --set world_simulator.pedestrian_driver=autopilot"
_ONE = "--set world_simulator.scenarios=[1] --set world_simulator.episodes=1 --set world_simulator.batch=1"
_EXAM = "--set world_simulator.scenarios=[1] --set world_simulator.episodes=1"
_STAGE1 = "--set learner.episodes=3 --set learner.replay.batch_size=16"
_STAGE2 = (
    "--set world_simulator.scenarios=[1] --set world_simulator.episodes=3 --set world_simulator.batch=8 "
    "--set learner.replay.batch_size=16 "
)
_CLASS = "--ads-class vpsci_ros.nodes.example_driver:ExampleDriver --set ads_test.pedestrians=[walker]"
_SEARCH = "--pedestrian walker --pool 100 --budget 40"
_DETERMINISTIC = "--params stage1_pretrain -o {out} -q --set learner.episodes=2 --set learner.replay.batch_size=16"
_FORMATS = ("openscenario", "commonroad", "osi", "scenarionet", "minari", "mp4", "carla-csv")
COMMANDS: dict[str, str] = {
    "import": "import {tracks} --format vci-citr -o {out}.parquet",
    "bag export": f"bag export {_BAG} -o {{out}} --episodes 166",
    "bag plot": f"bag plot {_BAG} 2:166 -o {{out}}.png",
    "dataset bag": "dataset bag {dataset} -o {out} --episode 1:0",
    "evaluate": "evaluate --json {out}.json",
    "generate": f"generate -o {{out}} --episodes 2 --scenarios 1 --workers 1 {_RULES}",
    "generate, learned": "generate -o {out} --episodes 4 --scenarios 1,2 --workers 2",
    "report": "report {dataset} -o {out}",
    "turing make": "turing make -o {out} --scenes 2",
    "turing score": "turing score {kit}/key.json {answers} -o {out}",
    "view": "view {dataset} -o {out}.html",
    "view of a bag": f"view {_BAG} -o {{out}}.html --limit 5",
    "world show": "world show 1 -o {out}.png",
    "study paper": "study paper {dataset} -o {out} -q",
    **{f"export to {name}": f"export {{dataset}} --to {name} -o {{out}} --episodes 0" for name in _FORMATS},
    "ads-test": f"ads-test -o {{out}} -q {_CLASS} {_EXAM}",
    "pretrain": f"pretrain --params stage1_pretrain -o {{out}} -q {_STAGE1}",
    "refine": f"refine -o {{out}} -q {_STAGE2}",
    "study samples": f"study samples {_DETERMINISTIC} --sizes 60",
    "study folds": f"study folds {_DETERMINISTIC} --folds 2",
    "study models": f"study models {_DETERMINISTIC} --folds 2 --models lstm",
    "study weights": "study weights --params stage2_online -o {out} -q --weightings equal --fresh-episodes 1 "
    + _STAGE2,
    "realism": "realism -o {out} --data {few} --library {few} -q",
    "graph": f"graph --params stage3_generate -o {{out}} -q {_ONE}",
    "ads-test, graph": f"ads-test -o {{out}} -q --ads example_ads --set ads_test.pedestrians=[walker] {_EXAM}",
    "search": f"ads-search -o {{out}} -q {_CLASS} {_EXAM} {_SEARCH}",
    "demo": "demo -o {out}",
}
"""The last ones take longest."""


class Ended(NamedTuple):
    """How a command ended: exit status, and what it printed on standard error."""

    status: int
    said: str


def inputs(folder: Path) -> dict[str, str]:
    """Make what the commands read, and return where each lies by its name in `COMMANDS`."""
    from chaos import files

    (folder / "tracks").mkdir()
    files._tracks(folder / "tracks")
    files._dataset(folder)
    given = {name: str(folder / name) for name in ("tracks", "dataset", "kit", "answers", "few")}
    given["few"] += ".parquet"
    write_near_misses(synthetic_near_misses(interactions=12, seed=3).table, given["few"])
    assert here("turing make", folder / "kit", given).status == 0
    key = json.loads((folder / "kit" / "key.json").read_text())
    given["answers"] += ".json"
    row = {"judgement": "real", "confidence": 2, "realism": 3, "seconds": 1.5, "shown": 1}
    rows = [row | {"clip": clip} for clip in key["clips"]]
    Path(given["answers"]).write_text(json.dumps({"kit": key["kit"], "rater": "a", "answers": rows}))
    return given


def words(command: str, out: Path, given: dict[str, str]) -> list[str]:
    """Return the words of a command that writes to `out`."""
    return COMMANDS[command].format(out=out, **given).split()


def here(command: str, out: Path, given: dict[str, str], largest: int = resource.RLIM_INFINITY) -> Ended:
    """Run a command in this process, with files of `largest` bytes at most, and look at how it ended."""
    said, status = io.StringIO(), 0
    before, handlers = resource.getrlimit(resource.RLIMIT_FSIZE), signal.getsignal(signal.SIGINT)
    arguments, sys.argv = sys.argv, ["vpsci", *words(command, out, given)]
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, before[1]))
    try:
        with contextlib.chdir(ROOT), contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
            main()
    except SystemExit as ended:
        status = int(ended.code or 0)
    except Exception as error:  # noqa: BLE001 - whatever is not in words is a defect
        status = 1
        print(f"Traceback (most recent call last): {type(error).__name__}: {error}", file=said)
    finally:
        sys.argv = arguments
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGINT, handlers)
    return Ended(status, said.getvalue())


def apart(
    command: str,
    out: Path,
    given: dict[str, str],
    meddle: Callable[["subprocess.Popen[bytes]"], None] = lambda _: None,
    before: tuple[str, ...] = (),
) -> Ended:
    """Run a command in a process of its own, under what `before` starts it with, while somebody meddles with it.

    :raises AssertionError: it took longer than `PATIENCE`.
    """
    line = [*before, sys.executable, "-m", "vpsci_ros.cli", *words(command, out, given)]
    said = out.parent / f".{out.name}.said"
    with said.open("wb") as file:
        process = subprocess.Popen(line, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=file, start_new_session=True)
        try:
            meddle(process)
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"it took more than {PATIENCE:g} s") from None
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    text = said.read_text(errors="replace")
    said.unlink()
    return Ended(process.returncode, text)


def fresh(folder: Path) -> Path:
    """Return an empty folder of this name."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder
