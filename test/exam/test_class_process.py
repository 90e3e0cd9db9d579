"""A driving system's class in a process of its own: whatever it does there, the exam has an answer to each scene."""

import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.drivers import Answer, Observation, Scene, as_odometry
from vpsci_ros.exam.process import class_process, files_of_class, find_driver
from vpsci_ros.runs.files import sha256
from vpsci_ros.world import World, WorldConfig, load_scenario
from vpsci_ros.world.observation import AGENTS

Drive = Callable[..., list[Answer]]
ONE = Answer("vehicle", (1.0, 0.0))


def a_scene(car: int = 0) -> Scene:
    config = WorldConfig(vehicle_driver="external", pedestrian_driver="autopilot", spawn="paper")
    state = World(config, [load_scenario(1)], [(1, car)], 1, 0).state
    motion = [as_odometry(state[0], agent) for agent in AGENTS]
    return Scene(car, (1, car), 7, Observation(0.0, motion[0], (motion[1],), 9.0, 20.0, state, np.array([9.0])))


def mine(act: str, before: str = "") -> str:
    """Return a module with a class whose `act` does this, and returns 1.0."""
    body = f"  def reset(self, begin): pass\n  def act(self, observation):\n    {act}\n    return 1.0\n"
    return f"{before}\nclass Mine:\n{body}"


@pytest.fixture
def drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forked_classes: Callable[[], AbstractContextManager[None]]
) -> Iterator[Drive]:
    """Yield the function that has a module's class `Mine` answer two scenes of a tick, so many times."""
    monkeypatch.chdir(tmp_path)

    def driven(text: str, ticks: int = 1, patience: float = 60.0) -> list[Answer]:
        (tmp_path / "a_driver.py").write_text(text)
        scenes = [a_scene(0), a_scene(1)]
        with class_process("a_driver:Mine", tmp_path / "log", 60.0) as process:
            process.make_drivers([load_scenario(1)], 2, "paper")
            process._patience = patience  # once it is there
            return [answer for _ in range(ticks) for answer in process.answers(scenes)]

    with forked_classes():
        yield driven


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("import os; os._exit(0)", "while its module was imported, the ADS ended with exit status 0"),
        (mine("") + "  def __init__(self):\n    raise SystemExit(0)", r"Mine\(\) cannot be made: SystemExit: 0$"),
        (mine("") + "  def __init__(self, car): pass", "'car'; the class of a driving system takes no argument"),
    ],
)
def test_a_class_that_cannot_be_made_is_refused_in_words(drive: Drive, text: str, said: str) -> None:
    with pytest.raises(InvalidInput, match=said):
        drive(text)


def test_the_log_has_the_traceback_of_a_class_that_cannot_be_made(drive: Drive, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="no model file"):
        drive(mine("") + "  def __init__(self):\n    raise RuntimeError('no model file')")
    assert re.search(r'Traceback.*a_driver.py", line \d+, in __init__', (tmp_path / "log").read_text(), re.DOTALL)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("class Other: pass", "has no class 'Mine'; it has Other"),
        ("class Mine:\n  def act(self, observation): ...", r"it has no reset; define reset\(begin\)"),
        ("import no_such_module_here", "cannot be imported: No module named 'no_such_module_here'"),
        ("1 / 0", "cannot be imported: ZeroDivisionError"),
        ("raise KeyboardInterrupt", "cannot be imported: KeyboardInterrupt"),
        ("import sys; sys.exit(0)", "ends the program while it is imported .SystemExit: 0.; put its main under"),
    ],
)
def test_a_module_without_a_driver_is_refused_with_what_it_lacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest, text: str, said: str
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    name = re.sub(r"\W", "_", request.node.name)
    (tmp_path / f"{name}.py").write_text(text)
    with pytest.raises(InvalidInput, match=said):
        find_driver(f"{name}:Mine")


def test_a_process_that_ends_in_the_middle_is_no_success(drive: Drive) -> None:
    answers = drive(mine("if COUNT.append(0) or len(COUNT) > 1: import os; os._exit(0)", "COUNT = []"), ticks=2)
    assert answers[0] == ONE
    assert all(answer.error.startswith("the ADS ended with exit status 0") for answer in answers[1:])
    assert len(answers) == 4


RAISED = {
    "raise asyncio.CancelledError('no')": "CancelledError: no",
    "sys.exit(0)": "SystemExit: 0",
    "raise ValueError('\\ud800 \\x1b[2J')": r"ValueError: \ud800 \x1b[2J",
    "raise type('Odd', (Exception,), {'__str__': lambda self: 1 / 0})": "Odd",
    "return '\\ud800'": r"act returned '\ud800'; expected an acceleration along the car",
    "return True": "act returned True",
}


def test_whatever_is_raised_or_returned_is_the_answer_to_that_scene_alone(drive: Drive) -> None:
    ways = "\n".join(f"    if len(COUNT) == {2 * n + 1}: {way}" for n, way in enumerate(RAISED))
    answers = drive(mine(f"COUNT.append(0)\n{ways}", "import asyncio, sys\nCOUNT = []"), ticks=len(RAISED))
    assert [answer.error.startswith(said) for answer, said in zip(answers[::2], RAISED.values(), strict=True)] == [
        True
    ] * len(RAISED)
    assert [answer.refused for answer in answers[::2]] == [way.startswith("return") for way in RAISED]
    assert answers[1::2] == [ONE] * len(RAISED)


SENT = {
    '["vehicle", [-1000.0, 0.0], "", "", false]': "act returned [-1000.0, 0.0]; expected an acceleration along the car",
    '["vehicle", [NaN, 0.0], "", "", false]': "act returned [nan, 0.0]; expected",
    '["vehicle", ["x"], "", "", false]': "act returned ['x']; expected",
    '["vehicle", [1.0, 0.0, 3.0, 4.0], "", "", false]': "act returned [1.0, 0.0, 3.0, 4.0]; expected",
}
UNREADABLE = {
    '["other", [1.0, 0.0], "", "", false]': "its process sent ['other', [1.0, 0.0], '', '', False], which is no answer",
    '["vehicle_control", [1.0, 0.0], "", "", false]': "its process sent ['vehicle_control', [1.0, 0.0], '', '', F",
    '["", [], "", "", false]': "its process sent ['', [], '', '', False], which is no answer",
    "[" * 100_000: "its process sent what is no JSON",
}


def test_a_wrong_command_that_did_not_pass_the_check_in_its_process_loses_that_scene_alone(drive: Drive) -> None:
    before = f"import json\nTEXTS = iter({[*SENT]!r})\nREAL = json.dumps"
    answers = drive(mine("json.dumps = lambda *a, **k: next(TEXTS, None) or REAL(*a, **k)", before), ticks=3)
    assert [answer.error.startswith(said) for answer, said in zip(answers, SENT.values(), strict=False)] == [True] * 4
    assert [(answer.form, answer.values, answer.refused) for answer in answers[:4]] == [("", (), True)] * 4
    assert answers[4:] == [ONE] * 2


@pytest.mark.parametrize("sent", UNREADABLE)
def test_a_process_that_sends_what_is_no_answer_is_given_up_with_what_it_sent(drive: Drive, sent: str) -> None:
    answers = drive(mine("json.dumps = lambda *a, **k: TEXT", f"import json\nTEXT = {sent!r}"), ticks=2)
    assert [answer.error.startswith(UNREADABLE[sent]) for answer in answers] == [True] * 4


@pytest.mark.parametrize(("number", "first"), [("", False), ("(2).to_bytes(8, 'big') + ", True)])
def test_an_answer_that_was_not_asked_for_ends_the_process_also_with_a_forged_number(
    drive: Drive, number: str, first: bool
) -> None:
    before = (
        "import gc, json\nfrom multiprocessing.connection import Connection\nreal = json.dumps\n"
        "here = [o for o in gc.get_objects() if isinstance(o, Connection)]"
    )
    act = f"here[0].send_bytes({number}real(['vehicle', [1.0, 0.0], '', '', False]).encode())"
    answers = drive(mine(act, before), ticks=2)
    assert [answer == ONE for answer in answers] == [first, False, False, False]
    assert {answer.error for answer in answers[1:]} == {"its process sent an answer that it was not asked for"}


@pytest.mark.parametrize("sent", ["5", '{"refused": 1}', '"x'])
def test_a_process_that_does_not_say_which_class_it_has_is_refused_in_words(drive: Drive, sent: str) -> None:
    with pytest.raises(InvalidInput, match="while its module was imported, its process sent what it may not"):
        drive(mine("", f"import json; json.dumps = lambda *a, **k: {sent!r}"))


def test_what_it_writes_into_what_it_sees_moves_nobody(drive: Drive) -> None:
    seen = "assert observation._state['pedestrian_x'][0] != 1e6; observation._state['pedestrian_x'] = 1e6"
    assert drive(mine(seen), ticks=2) == [ONE] * 4, "nor does it see that again itself"


def test_threads_and_copies_that_it_leaves_end_with_it(drive: Drive, tmp_path: Path) -> None:
    begun = time.monotonic()
    thread = "threading.Thread(target=time.sleep, args=(1000,)).start()"
    fork = f"if os.fork() == 0: open('{tmp_path}/pid', 'w').write(str(os.getpid())); time.sleep(1000)"
    waits = f"while not os.path.exists('{tmp_path}/pid') or not open('{tmp_path}/pid').read(): time.sleep(0.01)"
    act = f"if not COUNT:\n      COUNT.append(0)\n      {thread}\n      {fork}\n      {waits}"
    assert drive(mine(act, "import os, threading, time\nCOUNT = []")) == [ONE, ONE]
    assert time.monotonic() - begun < 500.0
    copy = int((tmp_path / "pid").read_text())
    while Path(f"/proc/{copy}").exists() and "\nState:\tZ" not in Path(f"/proc/{copy}/status").read_text():
        time.sleep(0.01)


def test_a_copy_that_comes_back_does_not_answer_a_second_time(drive: Drive) -> None:
    assert drive(mine("import os; os.fork()"), ticks=3) == [ONE] * 6


def test_a_class_that_never_returns_is_ended_whatever_it_catches(drive: Drive) -> None:
    act = "while True:\n      try: time.sleep(1000)\n      except BaseException: pass"
    assert [answer.error for answer in drive(mine(act, "import time"), 2, patience=0.1)] == ["no answer for 0.1 s"] * 4


def test_it_runs_in_the_folder_of_the_command_and_says_which_file_it_is_of(drive: Drive, tmp_path: Path) -> None:
    assert drive(mine(f"import os; assert os.getcwd() == {str(tmp_path)!r}; os.chdir('/')"))[0] == ONE
    assert Path.cwd() == tmp_path
    assert files_of_class("a_driver:Mine") == {"a_driver.py": sha256(tmp_path / "a_driver.py")}


def test_the_modules_that_it_imports_from_that_folder_are_its_files_too(drive: Drive, tmp_path: Path) -> None:
    (tmp_path / "kit").mkdir()
    for name in ("beside.py", "kit/core.py"):
        (tmp_path / name).write_text("SPEED = 4.0\n")
    drive(mine("", "import beside, kit.core"))
    before = files_of_class("a_driver:Mine")
    assert before.keys() == {"a_driver.py", "beside.py", "kit/core.py"}
    (tmp_path / "kit" / "core.py").write_text("SPEED = 5.0\n")
    after = files_of_class("a_driver:Mine")
    assert {name for name in before if before[name] != after[name]} == {"kit/core.py"}


@pytest.mark.parametrize(
    ("text", "said"), [("a_driver", "expected MODULE:CLASS"), ("no_such_module:Mine", "no module 'no_such_module'")]
)
def test_what_names_no_class_is_refused(monkeypatch: pytest.MonkeyPatch, text: str, said: str) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    with pytest.raises(InvalidInput, match=said):
        find_driver(text)
