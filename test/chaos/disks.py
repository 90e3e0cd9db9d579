"""Commands that write to disks which are full, read-only or limited.

A command ends with 0 and what it always writes, or not with 0, one line that says why, and nothing that could be taken
for a result: a file is there whole or not at all, and a folder that holds anything says that the command failed.
The disks are real: small file systems in memory, mounted for a case. That takes root, or `unshare -rm` before the
command.
"""

import contextlib
import io
import json
import random
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from vpsci_ros.cli.main import main
from vpsci_ros.resources import weights_path
from vpsci_ros.runs.files import FAILURE
from vpsci_ros.runs.record import RECORD

ROOT = Path(__file__).parents[2]
PLACES = ("full", "filling", "read-only", "limited")
BAG = "bags/LocationA_PedCross_N-S"
COMMANDS: dict[str, str] = {
    "import": "import {tracks} --format vci-citr -o {out}.parquet",
    "bag export": f"bag export {BAG} -o {{out}} --episodes 0-9",
    "bag plot": f"bag plot {BAG} 2:14 -o {{out}}.png",
    "dataset bag": "dataset bag {dataset} -o {out} --episode 1:0",
    "demo": "demo -o {out}",
    "evaluate": "evaluate --json {out}.json",
    "export": "export {dataset} --to openscenario,osi,carla-csv -o {out}",
    "generate": "generate -o {out} --episodes 2 --scenarios 1 --workers 1 "
    "--set world_simulator.vehicle_driver=autopilot --set world_simulator.pedestrian_driver=autopilot",
    "graph": "graph --params stage3_generate -o {out} --set world_simulator.scenarios=[1] "
    "--set world_simulator.episodes=1 --set world_simulator.batch=1",
    "pretrain": "pretrain --params stage1_pretrain -o {out} --set learner.episodes=3",
    "realism": "realism -o {out}",
    "report": "report {dataset} -o {out}",
    "turing make": "turing make -o {out} --scenes 2",
    "view": f"view {BAG} -o {{out}}.html",
    "world show": "world show 1 -o {out}.png",
}


class Case(NamedTuple):
    """A command on a disk: `size` [KiB] is how much room there is, or how large a file may become."""

    command: str
    place: str
    size: int

    def __str__(self) -> str:
        return f"{self.command} on a disk that is {self.place}, {self.size} KiB"


class Ended(NamedTuple):
    """How a command ended: exit status, standard error, and what does not hold, one sentence each."""

    status: int
    said: str
    defects: list[str]


def case(seed: int, commands: tuple[str, ...] = tuple(COMMANDS)) -> Case:
    """Draw a case; in each round every command meets every place once, but for the room that is left there."""
    rng = random.Random(f"disks/{seed}")
    place = PLACES[seed // len(commands) % len(PLACES)]
    return Case(commands[seed % len(commands)], place, 0 if place == "full" else round(2 ** rng.uniform(0, 12)))


def inputs(folder: Path) -> dict[str, str]:
    """Make what the commands read, and return where each lies by its name in `COMMANDS`."""
    from chaos import files

    (folder / "tracks").mkdir()
    files._tracks(folder / "tracks")
    files._dataset(folder)
    paths = {"tracks": folder / "tracks", "dataset": folder / "dataset", "weights": weights_path("refined")}
    return {name: str(path) for name, path in paths.items()}


@contextlib.contextmanager
def disk(case: Case, folder: Path) -> Iterator[Path]:
    """Mount the disk of a case in `folder`."""
    size = case.size if case.place == "filling" else 8 if case.place == "full" else 65536
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={max(size, 4)}k", "chaos", str(folder)], check=True)
    try:
        if case.place == "full":
            with contextlib.suppress(OSError), (folder / "full").open("wb") as file:
                while file.write(bytes(4096)):
                    file.flush()
        elif case.place == "read-only":
            subprocess.run(["mount", "-o", "remount,ro", str(folder)], check=True)
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def run(case: Case, given: dict[str, str]) -> Ended:
    """Run the command of a case on its disk, in this process, and look at what it left."""
    said, status = io.StringIO(), 0
    with tempfile.TemporaryDirectory() as folder, disk(case, Path(folder)) as place:
        words = COMMANDS[case.command].format(out=place / "out", **given).split()
        before = sys.argv, resource.getrlimit(resource.RLIMIT_FSIZE)
        sys.argv = ["vpsci", *words]
        if case.place == "limited":
            resource.setrlimit(resource.RLIMIT_FSIZE, (case.size * 1024, before[1][1]))
        try:
            with contextlib.chdir(ROOT), contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
                main()
        except SystemExit as ended:
            status = int(ended.code or 0)
        except Exception as error:  # noqa: BLE001 - whatever is not in words is a defect
            status = 1
            print(f"Traceback (most recent call last): {type(error).__name__}: {error}", file=said)
        finally:
            sys.argv = before[0]
            resource.setrlimit(resource.RLIMIT_FSIZE, before[1])
        return Ended(status, said.getvalue(), defects(status, said.getvalue(), place))


def defects(status: int, said: str, place: Path) -> list[str]:
    """Return what does not hold of a command that ended."""
    found = []
    if "Traceback (most recent call last)" in said:
        found.append(f"a traceback: {said.strip().splitlines()[-1]}")
    left = [path for path in place.iterdir() if path.name != "full"]
    if any(path.name.endswith(".part") for path in place.rglob("*")):
        found.append("a part of a file was left")
    if status == 0:
        return found if left else [*found, "status 0, and nothing was written"]
    if status < 0 or not said.strip():
        found.append(f"status {status} without a word")
    for path in left:
        if path.is_file():
            found.append(f"status {status}, but {path.name} is there")
        elif any(path.iterdir()) and not _is_marked(path):
            found.append(f"status {status}, and nothing says so among {sorted(p.name for p in path.iterdir())}")
    return found


def _is_marked(folder: Path) -> bool:
    for name in (FAILURE, RECORD):
        if (folder / name).is_file() and json.loads((folder / name).read_text())["error"]:
            return True
    return False
