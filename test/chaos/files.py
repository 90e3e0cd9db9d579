"""Damaged files of every kind that this package reads: each is read as it was written or refused with a clear error.

A kind makes a whole file (or a folder with one that is damaged) and reads it as its command does. What may come of a
damaged one is a value or `InvalidInput`; whatever else is a defect, among them more than `LIMIT` seconds, and, of the
kinds that carry checksums, another value than the whole file's.
"""

import contextlib
import hashlib
import io
import random
import shutil
import signal
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from chaos.mutate import mutated
from rich.console import Console
from synthetic import random_weights, synthetic_near_misses

from vpsci_ros.bags.info import bag_info
from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.dataset_description import DESCRIPTION
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.importers import import_trajectories
from vpsci_ros.data.near_misses import read_near_misses, write_near_misses
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.generate.generate_dataset import generate, part_writers
from vpsci_ros.generate.job import job_from
from vpsci_ros.generate.verify import job_of
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import load_weights, save_weights
from vpsci_ros.report.summary import print_info
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.workers import ThisMachine
from vpsci_ros.world.opendrive import OpenDriveMap
from vpsci_ros.world.scenario import load_scenario, scenario_files

LIMIT = 10  # [s] for one file, on a loaded machine
CORPUS = Path(__file__).parent / "corpus"
SMALL = NetworkConfig(hidden=16, heads=2)


class Kind(NamedTuple):
    """A kind of file.

    :ivar make: makes a whole one in an empty folder and returns the path of what is to be damaged.
    :ivar read: reads it and returns what came of it, to be compared where `sealed`.
    :ivar sealed: a change of its content is always noticed.
    """

    make: Callable[[Path], Path]
    read: Callable[[Path], Any]
    text: bool
    sealed: bool = False


class Found(NamedTuple):
    """What came of one case: "read", "refused", or a defect in words."""

    kind: str
    seed: int
    verdict: str
    data: bytes = b""

    @property
    def defect(self) -> bool:
        return self.verdict not in ("read", "refused", "undamaged")


class TookTooLong(BaseException):
    """Raised by the alarm; no `Exception`, so that nothing that reads can take it for a fault of the file."""


def case(name: str, seed: int, whole: bytes, path: Path) -> Found:
    """Damage the whole content by this seed, write it as `path`, read it, and say what came of it."""
    rng = random.Random(f"{name}/{seed}")
    data = mutated(whole, rng, text=KINDS[name].text)
    return Found(name, seed, "undamaged" if data == whole else verdict_of(name, data, whole, path), data)


def verdict_of(name: str, data: bytes, whole: bytes, path: Path) -> str:
    """Return the verdict on one content of a file of this kind."""
    kind = KINDS[name]
    path.write_bytes(data)
    try:
        with time_limit(), warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            value = kind.read(path)
    except InvalidInput as error:
        return "refused" if _is_clear(str(error)) else f"its error takes {len(str(error)):,} characters"
    except VpsciError:
        return "refused"
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # noqa: BLE001 - a panic of a library's Rust is no Exception, and a defect here
        return f"{type(error).__name__}: {' '.join(str(error).split())[:120]}"
    if kind.sealed and value != _undamaged(name, whole, path):
        return "read as something else, without a word"
    return "read"


def _is_clear(text: str) -> bool:
    return 10 < len(text) < 3000


_VALUES: dict[str, Any] = {}


def _undamaged(name: str, whole: bytes, path: Path) -> Any:
    if name not in _VALUES:
        path.write_bytes(whole)
        _VALUES[name] = KINDS[name].read(path)
    return _VALUES[name]


@contextlib.contextmanager
def time_limit(seconds: int = LIMIT) -> Iterator[None]:
    """Raise where a block computes for so long, or, computing or not, takes six times as long: others may be busy."""

    def late(*_: object) -> None:
        raise TookTooLong(f"more than {seconds} s")

    before = {kind: signal.signal(kind, late) for kind in (signal.SIGPROF, signal.SIGALRM)}
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, 6 * seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        for kind, handler in before.items():
            signal.signal(kind, handler)


def campaign(name: str, seeds: Iterable[int], report: Callable[[Found], None]) -> None:
    """Run the cases of a kind; each is reported as it ends."""
    with tempfile.TemporaryDirectory() as folder:
        path = KINDS[name].make(Path(folder))
        whole = path.read_bytes()
        for seed in seeds:
            report(case(name, seed, whole, path))


# What is made and read ------------------------------------------------------------------------------------------------


def _parameters(folder: Path) -> Path:
    return Path(shutil.copy(params_dir() / "stage2_online.yaml", folder))


def _scenario(folder: Path) -> Path:
    return Path(shutil.copy(scenario_files()[0], folder))


def _read_scenario(path: Path) -> str:
    return load_scenario(path).name


MAP = """<OpenDRIVE><header revMajor="1" revMinor="4"/>
<road id="1" length="30.0" junction="-1"><planView>
<geometry s="0.0" x="0.0" y="0.0" hdg="0.1" length="10.0"><line/></geometry>
<geometry s="10.0" x="9.95" y="1.0" hdg="0.1" length="10.0"><arc curvature="0.02"/></geometry>
<geometry s="20.0" x="19.7" y="2.9" hdg="0.3" length="10.0"><paramPoly3 pRange="arcLength" aU="0" bU="1" cU="0" dU="0"
 aV="0" bV="0" cV="0.001" dV="0"/></geometry></planView>
<lanes><laneOffset s="0.0" a="0.1" b="0.0" c="0.0" d="0.0"/><laneSection s="0.0"><center><lane id="0"/></center><right>
<lane id="-1" type="driving"><width sOffset="0.0" a="3.5" b="0.0" c="0.0" d="0.0"/></lane></right></laneSection></lanes>
<objects><object id="7" type="crosswalk" s="15.0" t="0.0" hdg="1.57"><outline><cornerLocal u="-4" v="-2" z="0"/>
<cornerLocal u="4" v="-2" z="0"/><cornerLocal u="4" v="2" z="0"/><cornerLocal u="-4" v="2" z="0"/></outline></object>
</objects></road></OpenDRIVE>
"""


def _map(folder: Path) -> Path:
    path = folder / "map.xodr"
    path.write_text(MAP, encoding="utf-8")
    return path


def _read_map(path: Path) -> None:
    road_map = OpenDriveMap(path)
    road_map.route([(1, -1)])
    for item in road_map.crosswalks():
        road_map.crosswalk(item)


def _near_misses(folder: Path) -> Path:
    path = folder / "near_misses.parquet"
    write_near_misses(synthetic_near_misses(3).table, path)
    return path


def _layout(folder: Path) -> Path:
    rows = [f"1,{k},car,{0.6 * k:.2f},0,6,0,0" for k in range(40)] + [
        f"2,{k},person,9,{0.15 * k - 3:.2f},0,1.5,0" for k in range(40)
    ]
    (folder / "clip.csv").write_text("\n".join(["track,frame,kind,x,y,vx,vy,yaw", *rows]) + "\n", encoding="utf-8")
    path = folder / "layout.yaml"
    path.write_text(
        "files: '*.csv'\ncolumns: {id: track, frame: frame, class: kind, x: x, y: y, vx: vx, vy: vy, heading: yaw}\n"
        "vehicles: [car, bus]\npedestrians: [person]\nframe_rate: 10\nmetres: 1.0\ndegrees: false\n"
        "length: 4.5\nwidth: 1.8\n",
        encoding="utf-8",
    )
    return path


def _described_clip(folder: Path) -> Path:
    _layout(folder)
    return folder / "clip.csv"


def _weights(folder: Path) -> Path:
    path = folder / "weights.safetensors"
    save_weights(path, random_weights(SMALL))
    return path


def _dataset(folder: Path) -> Path:
    """Two episodes of the rule-based pair; what is damaged is the description."""
    sections = load("stage3_generate", RULES)
    job = job_from(sections)
    generate(job, {1: 2}, folder / "dataset", partial(part_writers, job, 8, ThisMachine()))
    return folder / "dataset" / DESCRIPTION


def _read_dataset(path: Path) -> None:
    print_info(path.parent, Console(file=io.StringIO()))
    data = Dataset(path.parent)
    for _ in data.read():
        data.index()
    job_of(data)


def _bag(folder: Path) -> Path:
    from dataclasses import asdict

    from vpsci_ros.bags.run_record import node_record
    from vpsci_ros.bags.simulated import write_ticks
    from vpsci_ros.world import World, WorldConfig, load_scenarios
    from vpsci_ros.world.loop import Loop

    config = WorldConfig(spawn="paper", episode_time=4.0, vehicle_driver="autopilot", pedestrian_driver="autopilot")
    world = World(config, load_scenarios([1]), [(1, 0), (1, 1)], 1, 3)
    run = {"seed": 3, "scenarios": [1], "batch": 1, "queue": [(1, 0), (1, 1)]}
    nodes = [node_record("world_simulator", asdict(config) | run), node_record("safety_monitor", {})]
    write_ticks(Loop(world), config, folder / "bag", {}, nodes)
    (path,) = (folder / "bag").glob("*.mcap")
    return path


def _read_bag(path: Path) -> str:
    info = bag_info(path.parent)
    if info["damage"]:
        raise InvalidInput(f"{path}: {info['damage'][0]}")
    return hashlib.sha256(repr(info["episodes"]).encode()).hexdigest()


DRIVERS = ("vehicle_driver", "pedestrian_driver")
RULES = ["world_simulator.scenarios=[1]", *(f"world_simulator.{driver}=autopilot" for driver in DRIVERS)]
KINDS = {
    "dataset": Kind(_dataset, _read_dataset, text=True),
    "parameters": Kind(_parameters, load, text=True),
    "scenario": Kind(_scenario, _read_scenario, text=True),
    "opendrive": Kind(_map, _read_map, text=True),
    "near_misses": Kind(_near_misses, read_near_misses, text=False),
    "layout": Kind(_layout, lambda path: import_trajectories(path.parent, "described"), text=True),
    "described": Kind(_described_clip, lambda path: import_trajectories(path.parent, "described"), text=True),
    "weights": Kind(_weights, lambda path: load_weights(path).digest(), text=False, sealed=True),
    "weights_header": Kind(_weights, lambda path: load_weights(path).digest(), text=True, sealed=True),
    "bag": Kind(_bag, _read_bag, text=False, sealed=True),
}
