"""A driving system as a process: started without a shell, watched, and gone afterwards with all that it started."""

import os
import sys
import time
from pathlib import Path

import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.process import command_of, failure, files_of, flood, running, silence
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
    assert list(files_of("example_ads")) == ["example_ads.py"]


def test_a_process_that_ends_tells_how_and_what_it_said_last(tmp_path):
    script = "import sys; print('loading'); sys.exit('no weights')"
    with running([sys.executable, "-c", script], tmp_path / "log") as ads:
        wait_until(lambda: failure(ads))
        assert failure(ads).startswith("the ADS ended with exit status 1, having said 'no weights'")


def test_a_process_is_gone_afterwards_with_its_children_even_if_it_ignores_signals(tmp_path, monkeypatch):
    hurried = [(number, 0.2) for number, _ in STEPS]
    monkeypatch.setattr("vpsci_ros.exam.process.stop", lambda processes: stop(processes, hurried))
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


def seen(*pairs):
    check = silence(20)
    said = [
        check({"world_simulator.tick": float(t), "world_simulator.vehicle_answers_missing": float(m)}) for t, m in pairs
    ]
    return said[-1]


def test_an_ads_that_misses_single_ticks_is_not_silent():
    assert seen((100, 2), (500, 15), (2000, 60)) == ""


def test_an_ads_that_answers_nothing_for_the_limit_is_silent_and_not_before():
    assert seen((0, 0), (19, 19)) == ""
    assert "no usable command for 20 ticks" in seen((0, 0), (20, 20))
    assert "no usable command for 21 ticks" in seen((900, 3), (912, 12), (926, 24))


def test_the_silence_of_one_graph_is_not_that_of_the_next():
    assert seen((900, 30), (10, 1), (100, 2)) == ""


def test_silence_says_whether_commands_came_and_were_refused():
    check = silence(20)
    ticks = {"world_simulator.tick": 30.0, "world_simulator.vehicle_answers_missing": 30.0}
    assert check(ticks).endswith("; none came")
    refused = ticks | {"world_simulator.vehicle_commands_refused": 29.0}
    assert check(refused).endswith("; the 29 that came were refused: late, not finite or out of range")


def flooding(limit=100, late=False, **counts):
    return flood({f"world_simulator.{name}": float(count) for name, count in counts.items()}, limit, late=late)


def test_more_surplus_commands_a_tick_than_the_limit_are_a_flood():
    assert flooding(tick=124, vehicle_commands_surplus=12500) == ""
    assert flooding(tick=124, vehicle_commands_surplus=12501) == (
        "the ADS floods: 12501 commands beyond the first one of a tick in 124 ticks, more than 100 a tick "
        "(ads_test.surplus_limit)"
    )
    assert flooding(tick=2, vehicle_commands_surplus=2000) == "", "too few to tell"


def test_commands_before_the_first_tick_are_a_flood_only_where_that_never_comes():
    assert flooding(tick=0, vehicle_commands_early=9000) == ""
    assert flooding(tick=5, vehicle_commands_early=9000, late=True) == ""
    assert "9000 commands before the first tick, which never came" in flooding(
        tick=0, vehicle_commands_early=9000, late=True
    )
