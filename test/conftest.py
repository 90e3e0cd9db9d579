"""What the tests of several rooms use."""

import contextlib
import fcntl
import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import browser as real
import numpy as np
import pytest
from bags.rule_based import bag_of_the_rule_based_pair
from fork_server import ForkedProcess, ForkServer
from numpy.typing import NDArray
from synthetic import block_of_pairs, synthetic_near_misses

from vpsci_ros.data.dataset import DatasetWriter, write_blocks
from vpsci_ros.data.episode_block import EpisodeBlock
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.state import COLLISION, EPISODE, RUNNING

ROOT = Path(__file__).parents[1]
DT, FRAMES = 0.05, 180
VEHICLE_YIELDS, PEDESTRIAN_YIELDS = "LocationA_PedCross_S-N", "LocationA_PedCross_N-S"
SMALL = NetworkConfig(hidden=16, heads=2)
GRAPHS = {"chaos", "examples", "extending", "nodes"}  # rooms whose tests start nodes
LONGEST = {"test_code_style.py", "test_site.py"}  # mypy and the tutorial: most of a minute each
COMPILING = ["world_simulator", "safety_monitor", "vehicle_policy", "perception", "recorder"]  # each kernel once


class SimulatedTick(NamedTuple):
    """A tick as `EpisodeFrames` takes it: EPISODE[B], CurvTTC [s] and distance [m], float64[B] each."""

    state: NDArray[np.void]
    curvttc: NDArray[np.float64]
    distance: NDArray[np.float64]


@pytest.fixture(autouse=True, scope="session")
def held_out() -> Iterator[None]:
    """Hold out clips that can be measured: of the few synthetic near misses those by seed 1 end too early."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vpsci_ros.data.corpus.SPLIT", 4)
        yield


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Yield a browser, closed with the module: while Playwright has one, this thread's event loop counts as running."""
    yield from real.start()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest tests first, so that none of them is the last one, for which all other processes wait."""
    items.sort(key=lambda item: item.path.name not in LONGEST)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_terminal_summary(terminalreporter: Any) -> Iterator[None]:
    """Say in the last line how many tests of pages lacked a browser, and which command brings one."""
    yield
    lacking = [one for one in terminalreporter.stats.get("skipped", []) if real.NO_BROWSER in str(one.longrepr)]
    if lacking:
        how = "`sudo apt-get install chromium`, or `.venv/bin/playwright install chromium`"
        terminalreporter.write_line(
            f"not tested: {len(lacking)} tests of pages, which need a browser; {how} brings one"
        )


@pytest.hookimpl(wrapper=True, tryfirst=True)  # around the time limit of a test, which does not allow for it
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Have what nodes run compiled before the first test but the longest, which need no kernel."""
    if item.path.name not in LONGEST:
        compile_for_nodes(item.session)
    return (yield)


@cache
def compile_for_nodes(session: pytest.Session) -> None:
    """Run a small graph of all nodes in one process, if any test starts nodes.

    It takes most of a minute, once for each state of the sources; one worker does it and the others wait.
    """
    if not any(GRAPHS & set(item.path.parts) for item in session.items):
        return
    from vpsci_ros.nodes.domain import own_domain

    kernels = Path(os.environ.get("NUMBA_CACHE_DIR") or tempfile.gettempdir())  # of these sources
    with (kernels / "graph.lock").open("w") as lock, own_domain(), tempfile.TemporaryDirectory() as folder:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (kernels / "graph.compiled").exists():
            world = {"scenarios": [104], "episodes": 1, "episode_time": 2.0, "batch": 1, "pedestrians": 3}
            world |= {"action_timeout": 600.0, "pedestrian_driver": "autopilot"}
            settings = [f"graph.nodes=[{', '.join(COMPILING)}]", "graph.progress_timeout=1200.0"]
            settings += ["graph.composed=true"]  # or each node would compile the same
            settings += [f"world_simulator.{name}={value}" for name, value in world.items()]
            command = [sys.executable, "-m", "vpsci_ros.cli", "graph", "-q", "-o", f"{folder}/run"]
            command += ["--params", str(ROOT / "params" / "stage3_generate.yaml")]
            command += [word for setting in settings for word in ("--set", setting)]
            subprocess.run(command, check=True, cwd=ROOT, timeout=1800)
            (kernels / "graph.compiled").touch()


@pytest.fixture
def claimed_by_another() -> Callable[[Path], contextlib.AbstractContextManager[None]]:
    """Hold the lock of an output folder as another process does, by another open file."""

    @contextlib.contextmanager
    def claim(folder: Path) -> Iterator[None]:
        handle = os.open(folder, os.O_RDONLY)
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
        os.close(handle)

    return claim


@pytest.fixture(scope="session")
def tool() -> Callable[..., ModuleType]:
    """Return the function that imports a file of tools/, or of another folder, by its name."""

    def imported(name: str, folder: str = "tools") -> ModuleType:
        spec = importlib.util.spec_from_file_location(name, ROOT / folder / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return imported


@pytest.fixture(scope="session")
def simulate() -> Callable[..., Iterator[SimulatedTick]]:
    """Make ticks of episodes 0, 1, ... of scenario 1 in `batch` slots: (state, curvttc, distance), all ends included.

    Every car drives at 5 m/s along its heading of 0.5 rad, every pedestrian walks at 1.5 m/s; episode k takes
    `lengths[k]` frames, and has the outcome `outcomes[k]`.
    """

    def ticks(lengths: list[int], outcomes: list[int], batch: int) -> Iterator[SimulatedTick]:
        state = np.zeros(batch, EPISODE)
        queue = list(range(len(lengths)))
        while True:
            for slot in range(batch):
                record = state[slot]
                ended = record["status"] != 0 and record["frame"] + 1 == lengths[record["episode"]]
                if ended or record["status"] == 0:
                    record["status"] = 0
                    if queue:
                        record["episode"], record["frame"], record["outcome"] = queue.pop(0), 0, 0
                        record["scenario"], record["status"] = 1, RUNNING
                else:
                    record["frame"] += 1
                if record["status"] and record["frame"] + 1 == lengths[record["episode"]]:
                    record["status"], record["outcome"] = 2, outcomes[record["episode"]]
            if not state["status"].any():
                return
            time = 0.05 * state["frame"]
            state["vehicle_heading"], state["vehicle_speed"] = 0.5, 5.0
            state["vehicle_x"], state["vehicle_y"] = 5.0 * np.cos(0.5) * time, 5.0 * np.sin(0.5) * time
            state["pedestrian_x"], state["pedestrian_vx"] = 10.0 + state["episode"], 0.0
            state["pedestrian_y"], state["pedestrian_vy"] = -4.0 + 1.5 * time, 1.5
            curvttc = np.where(time > 1.0, 4.0 + 0.01 * state["episode"], np.inf)
            distance = np.hypot(state["vehicle_x"] - state["pedestrian_x"], state["vehicle_y"] - state["pedestrian_y"])
            yield SimulatedTick(state.copy(), curvttc, distance)

    return ticks


@pytest.fixture(scope="session")
def own_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of three episodes by the rule-based pair; not to be changed."""
    return bag_of_the_rule_based_pair(tmp_path_factory.mktemp("own") / "bag", 10.0)


@pytest.fixture(scope="session")
def short_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first half second of each of these episodes; not to be changed."""
    return bag_of_the_rule_based_pair(tmp_path_factory.mktemp("short") / "bag", 0.5)


@pytest.fixture(scope="session")
def fork_server() -> Iterator[ForkServer]:
    """The process that forks nodes and driving systems' classes."""
    with contextlib.closing(ForkServer()) as server:
        yield server


@pytest.fixture(scope="module")
def forked_nodes(fork_server: ForkServer) -> Iterator[None]:
    """Have graphs of this module fork their nodes."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("vpsci_ros.nodes.graph.ChildProcess", partial(ForkedProcess, fork_server))
        yield


@pytest.fixture(scope="session")
def forked_classes(fork_server: ForkServer) -> Callable[[], contextlib.AbstractContextManager[None]]:
    """Fork the processes of driving systems' classes in a `with` block."""

    @contextlib.contextmanager
    def forked() -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr("vpsci_ros.exam.process.ChildProcess", partial(ForkedProcess, fork_server))
            yield

    return forked


@pytest.fixture(autouse=True)
def one_thread() -> None:
    """Have torch, where a test's room uses it, take one thread: small networks only wait for each other in two."""
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


def data_with(*folders: str) -> Path:
    """Return the folder of data that the package does not hold, VPSCI_DATA or shared/data beside the repository."""
    folder = Path(os.environ.get("VPSCI_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if missing := [name for name in folders if not (folder / name).is_dir()]:
        pytest.skip(f"no {', '.join(missing)} in {folder}; set VPSCI_DATA")
    return folder


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder with the recordings vci_dut and vci_citr."""
    return data_with("vci_dut", "vci_citr")


@pytest.fixture(scope="session")
def town10hd() -> Path:
    """Folder with the map of Town10HD and its right turns."""
    return data_with("town10hd") / "town10hd"


@pytest.fixture(scope="session")
def near_misses():
    return synthetic_near_misses(interactions=16, seed=3).table


@pytest.fixture(scope="session")
def near_misses_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of 40 near misses; not to be changed."""
    from vpsci_ros.data.near_misses import write_near_misses

    path = tmp_path_factory.mktemp("near_misses") / "near_misses.parquet"
    write_near_misses(synthetic_near_misses(interactions=40, seed=1).table, path)
    return path


@pytest.fixture(scope="session")
def networks():
    """Return the function that makes networks whose actors act strongly, with a normalisation that does something."""
    return _networks


def _networks(config: NetworkConfig = SMALL, seed: int = 0, gain: float = 200.0):
    import torch

    from vpsci_ros.learning.networks import Networks

    torch.manual_seed(seed)
    made = Networks(config)
    rng = np.random.default_rng(seed)
    made.set_statistics(
        {agent: rng.normal(1.0, 2.0, (50, 6)).astype(np.float32) for agent in AGENTS},
        {agent: rng.normal(0.0, 1.0, (50, 2)).astype(np.float32) for agent in AGENTS},
        0.3,
    )
    with torch.no_grad():
        for agent in AGENTS:
            made.actor[agent].head[-1].weight.mul_(gain)
    return made


def motion(speed: np.ndarray) -> np.ndarray:
    """Return the way [m] that lies behind at each frame at these speeds [m/s]."""
    return np.concatenate([[0.0], np.cumsum(speed[:-1])]) * DT


def encounter(vehicle_yields: bool, n: int, scenario: int, least: np.ndarray) -> EpisodeBlock:
    """Return n episodes: a car along y = 0 to x = 25 m, a pedestrian up x = 20 m; who yields stands in the middle."""
    t = np.arange(FRAMES) * DT
    pause = 1.0 - 0.98 * np.clip((t - 2.0) / 0.8, 0.0, 1.0) + 0.98 * np.clip((t - 6.0) / 0.8, 0.0, 1.0)
    drive, walk = (5.0 * pause, 1.4 + 0.0 * t) if vehicle_yields else (5.0 + 0.0 * t, 1.4 * pause)
    values = np.zeros((n, FRAMES, 10), np.float32)
    values[..., 0] = motion(drive)
    values[..., 2] = drive
    values[..., 4] = 20.0
    values[..., 5] = -4.5 + motion(walk)
    values[..., 7] = walk
    values[..., 8] = np.hypot(values[..., 0] - 20.0, values[..., 5])
    values[..., 9] = np.where((t > 1.5) & (t < 3.0), least[:, None], np.inf)
    block = block_of_pairs(values, scenario)
    block.records["outcome"][-1] = COLLISION
    return block


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a dataset of 4, 3 and 1 episodes; one of the second scenario, and the third's, never are critical."""
    folder = tmp_path_factory.mktemp("analysis") / "dataset"
    with DatasetWriter(folder, {1: VEHICLE_YIELDS, 2: PEDESTRIAN_YIELDS, 3: "empty"}, {"period": DT}) as writer:
        two = encounter(True, 4, 1, np.array([1.0, 2.0, 3.0, 4.0])), encounter(False, 3, 2, np.array([9.0, 2.5, 1.5]))
        write_blocks(writer, [*two, encounter(True, 1, 3, np.array([7.0]))])
        writer.close()
    return folder


@pytest.fixture(scope="session")
def harmless_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a dataset of one episode that never was critical, so that none was kept."""
    folder = tmp_path_factory.mktemp("analysis") / "harmless"
    with DatasetWriter(folder, {1: VEHICLE_YIELDS}, {"period": DT}) as writer:
        write_blocks(writer, [encounter(True, 1, 1, np.array([7.0]))])
        writer.close()
    return folder
