"""A driving system behind a socket: a client in C++ with the Python class's numbers, and systems that misbehave."""

import contextlib
import json
import shutil
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from class_in_process import class_in_process

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.conduct import run_exam
from vpsci_ros.exam.drivers import Observation
from vpsci_ros.exam.exam import prepare
from vpsci_ros.extras.exam_extra.socket_driver import SocketDriver, connected, prepare_socket
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.workers import ThisMachine
from vpsci_ros.wire.layout import PlanarMotion

SOURCE = Path(__file__).parents[3] / "examples" / "socket_ads.cpp"
EXAMPLE = "vpsci_ros.nodes.example_driver:ExampleDriver"
MOTION = PlanarMotion(0.0, 0.0, 0.0, 1.0, 0.0)
CLIENT = """
import json, os, socket
wire = socket.create_connection(("127.0.0.1", int(os.environ["VPSCI_ADS_PORT"]))).makefile("rw")
for message in map(json.loads, wire):
    if message["type"] == "tick":
        {act}
        print(json.dumps({{"tick": message["tick"], "command": command}}), file=wire, flush=True)
"""


def examined(folder: Path, **ads: Any) -> tuple[list[str], Path]:
    """Put a system to an exam of two episodes, on the empty road and with the walker."""
    short = {"scenarios": [1, 104], "episodes": 1, "episode_time": 1.0}
    exam = {"pedestrians": ["walker"], "baseline": False, "allow_standing": True}
    chosen = load(params_dir() / "ads_test.yaml").changed("world_simulator", short).changed("ads_test", exam)
    exam = prepare(chosen, ads_class=ads["ads_class"]) if "ads_class" in ads else prepare_socket(chosen, ads["ads"], 0)
    return run_exam(exam, folder, quiet=True), folder


def program(folder: Path, act: str) -> str:
    """Write a client that does this at a tick, and return the command that starts it."""
    (folder / "ads.py").write_text(CLIENT.format(act=act))
    return f"{sys.executable} {folder / 'ads.py'}"


def test_the_client_in_cpp_has_the_report_of_the_python_class_to_the_last_bit(tmp_path: Path) -> None:
    compiler = next(filter(shutil.which, ("c++", "g++", "clang++")))
    binary = tmp_path / "socket_ads"
    strict = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *strict, "-o", binary, SOURCE], check=True, timeout=120)
    failures, by_socket = examined(tmp_path / "socket", ads=str(binary))
    assert failures == []
    with class_in_process():
        _, by_class = examined(tmp_path / "class", ads_class=EXAMPLE)
    tables = [pl.read_parquet(folder / "episodes.parquet") for folder in (by_socket, by_class)]
    assert tables[0].height == 4
    assert tables[0].equals(tables[1])
    reports = [json.loads((folder / "report.json").read_text()) for folder in (by_socket, by_class)]
    assert reports[0].pop("exam")["ads_files_sha256"].keys() == {"socket_ads"}
    reports[1].pop("exam")
    assert reports[0] == reports[1]


def test_a_system_that_dies_loses_what_is_left_and_the_report_has_its_last_words(tmp_path: Path) -> None:
    act = "exit('no plan')"
    failures, _ = examined(tmp_path / "exam", ads=program(tmp_path, act))
    first = "empty road: the ADS did not drive 1:0 and 1 more to the end: at 0.00 s the ADS ended with exit status 1"
    assert failures[0].startswith(f"{first}, having said 'no plan'")
    assert len(failures) == 1, "with a run in which nothing was driven the exam ends"


@pytest.mark.parametrize(
    ("act", "said"),
    [
        ("command = 'brake'", "act returned 'brake'; expected an acceleration along the car"),
        ("command = 1.0; message['tick'] -= 1", 'expected {"tick": 0, "command": ...}, got \'{"tick": -1'),
        ("command = 1.0; wire.write('{' * 3)", 'expected {"tick": 0, "command": ...}, got \'{{{'),
    ],
)
def test_what_is_no_answer_to_the_tick_loses_its_episode(tmp_path: Path, act: str, said: str) -> None:
    failures, _ = examined(tmp_path / "exam", ads=program(tmp_path, act))
    assert said in failures[0]


SEEN: Any = Observation(0.0, MOTION, (), 9.0, 9.0, *[np.zeros(1)] * 2, None)  # type: ignore[arg-type]


def a_driver(patience: float) -> tuple[SocketDriver, socket.socket]:
    """Return a driver, and the other end of its connection."""
    mine, theirs = socket.socketpair()
    return SocketDriver(mine, patience, lambda: ""), theirs


def test_a_silent_system_and_one_that_floods_are_given_up_once_and_for_all() -> None:
    silent, theirs = a_driver(0.01)
    with theirs:
        for _ in range(2):
            with pytest.raises(InvalidInput, match=r"no answer for 0\.01 s"):
                silent.act(SEEN)
    flooded, theirs = a_driver(5.0)
    with theirs:
        sender = threading.Thread(target=lambda: theirs.recv(65_536) and theirs.sendall(b"1" * 70_000))
        sender.start()
        with pytest.raises(InvalidInput, match="more than 65536 bytes without an end of line"):
            flooded.act(SEEN)
        sender.join()


def test_a_system_that_answers_byte_by_byte_has_no_more_patience_than_one_that_is_silent() -> None:
    driver, theirs = a_driver(0.3)
    sent: list[bytes] = []

    def drip() -> None:
        theirs.recv(65_536)
        with contextlib.suppress(OSError):  # the driver has closed its end
            while len(sent) < 1000:
                theirs.sendall(b" ")
                sent.append(b" ")
                time.sleep(0.01)

    with theirs:
        sender = threading.Thread(target=drip)
        sender.start()
        with pytest.raises(InvalidInput, match=r"no answer for 0\.3 s"):
            driver.act(SEEN)
        sender.join()
    assert 0 < len(sent) < 1000


def test_a_system_that_answers_ahead_of_the_tick_is_given_up() -> None:
    driver, theirs = a_driver(5.0)
    with theirs:
        theirs.sendall(b'{"tick": 0, "command": 1.0}\n{"tick": 1, "command": 1.0}\n')
        for _ in range(2):
            with pytest.raises(InvalidInput, match='it answered before it was sent the tick: \'{"tick": 0'):
                driver.act(SEEN)


def test_who_does_not_connect_in_time_has_not_driven_and_a_port_in_use_is_said_so(tmp_path: Path) -> None:
    waits = f"{sys.executable} -c 'import time; time.sleep(60)'"
    with connected(waits, 0, 0.05, tmp_path / "log", 0.3) as make, pytest.raises(InvalidInput, match="did not connect"):
        make().reset(_begin())
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        refused = pytest.raises(InvalidInput, match="cannot listen there")
        with refused, connected("external", port, 0.05, tmp_path, 0.3):
            pass


def _begin() -> Any:
    from vpsci_ros.exam.drivers import Begin
    from vpsci_ros.world import load_scenario

    return Begin(load_scenario(1), 0, 0)


def test_options_that_do_not_go_together_are_refused() -> None:
    found = load(params_dir() / "ads_test.yaml")
    for ads, port, said in (
        ("example_ads", 0, "give a command of your own with port 0"),
        ("external", 0, "'external' with the port to which you connect it"),
        ("sh", 5577, "give a command of your own with port 0"),
    ):
        with pytest.raises(InvalidInput, match=said):
            prepare_socket(found, ads, port)
    with pytest.raises(InvalidInput, match="in one graph only"):
        prepare_socket(found, "external", 5577, workers=ThisMachine(2))
    real = found.changed("world_simulator", {"external_mode": "real_time"})
    with pytest.raises(InvalidInput, match="external_mode = real_time"):
        prepare_socket(real, "sh", 0)
