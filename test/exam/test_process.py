"""A driving system as a process: started without a shell, watched, and gone afterwards with all that it started."""

import os
import sys
import time
from pathlib import Path

import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.process import command_of, failure, files_of, running
from vpsci_ros.runs.processes import STEPS, stop


def wait_until(condition, seconds=30.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_command_is_split_and_never_given_to_a_shell():
    assert command_of(f"{sys.executable} 'my ads.py' --speed '4; rm x'") == [
        sys.executable, "my ads.py", "--speed", "4; rm x"]  # fmt: skip
    assert command_of("example_ads")[1:] == ["-m", "vpsci_ros.nodes.example_ads"]


@pytest.mark.parametrize(
    ("text", "said"), [("no_such_program --x", "no program 'no_such_program'"), ("'open", "not a command line")]
)
def test_a_command_that_cannot_be_is_refused(text, said):
    with pytest.raises(InvalidInput, match=said):
        command_of(text)


def test_the_files_that_a_command_names_are_hashed(tmp_path):
    script = tmp_path / "ads.py"
    script.write_text("print()")
    assert list(files_of(f"python {script} --speed 4")) == ["ads.py"]
    assert list(files_of("example_ads")) == ["example_ads.py", "example_driver.py"]


def test_a_process_that_ends_tells_how_and_what_it_said_last(tmp_path):
    script = "import sys; print('loading'); sys.exit('no weights')"
    with running([sys.executable, "-c", script], tmp_path / "log") as ads:
        wait_until(lambda: failure(ads))
        assert failure(ads).startswith("the ADS ended with exit status 1, having said 'no weights'")


def test_a_process_is_gone_afterwards_with_its_children_even_if_it_ignores_signals(tmp_path, monkeypatch):
    hurried = [(number, 0.2) for number, _ in STEPS]
    monkeypatch.setattr("vpsci_ros.exam.process.stop", lambda processes, _: stop(processes, hurried))
    script = (
        "import signal, subprocess, sys, time; signal.signal(signal.SIGINT, signal.SIG_IGN);"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN);"
        "print(subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)']).pid, flush=True);"
        "time.sleep(600)"
    )
    log = tmp_path / "log"
    with running([sys.executable, "-c", script], log) as ads:
        wait_until(lambda: log.read_text().endswith("\n"))
        child = int(log.read_text())
        assert failure(ads) == ""
    wait_until(lambda: not Path(f"/proc/{child}").exists() or "Z" in Path(f"/proc/{child}/stat").read_text())
    assert failure(ads).startswith("the ADS was killed by SIGKILL")


def test_the_environment_is_that_of_the_exam_without_the_libraries_of_its_python(tmp_path, monkeypatch):
    monkeypatch.setenv("LD_LIBRARY_PATH", os.pathsep.join([f"{sys.prefix}/lib", "/opt/mine/lib"]))
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    log = tmp_path / "log"
    with running(["/usr/bin/env"], log) as ads:
        wait_until(lambda: failure(ads))
    found = dict(line.split("=", 1) for line in log.read_text().splitlines() if "=" in line)
    assert found["LD_LIBRARY_PATH"] == "/opt/mine/lib"
    assert found["ROS_DOMAIN_ID"] == "42"
    assert found["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert "_ROS_WHEELS_BOOTSTRAP_COMPLETE" not in found
