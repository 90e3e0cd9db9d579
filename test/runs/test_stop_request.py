"""A request to stop is heard and nothing waits for ever, however many signals come one upon the other."""

import os
import signal
import subprocess
import sys
import time

import pytest

from vpsci_ros.errors import Stopped
from vpsci_ros.runs.stop_request import stop_requested_by_signals

SIGNALS = (signal.SIGINT, signal.SIGTERM)
BETWEEN_UPDATES = """
from vpsci_ros.errors import Stopped
from vpsci_ros.runs.stop_request import stop_requested_by_signals

with stop_requested_by_signals() as stop:
    print("ready", flush=True)
    try:
        while True:
            stop.check()
    except Stopped:
        print("stopped", flush=True)
        input()
"""
NODE = """
import sys
from rclpy.context import Context
from vpsci_ros.nodes.base import GraphNode, run_together

class Idle(GraphNode):
    def __init__(self, *, context: Context) -> None:
        super().__init__("safety_monitor", context=context)
        print("ready", flush=True)

    def close(self) -> None:
        print("stopped", flush=True)
        input()

sys.exit(run_together([Idle]))
"""


@pytest.mark.parametrize("program", [BETWEEN_UPDATES, NODE], ids=["learning", "node"])
def test_signals_in_the_middle_of_the_handler_of_another_signal_stop_a_process_and_do_not_block_it(
    program: str,
) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ
    ) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        assert process.stdout.readline() == "ready\n"
        until = time.monotonic() + 1.0
        while time.monotonic() < until:
            process.send_signal(SIGNALS[0])
            process.send_signal(SIGNALS[1])
        try:
            process.communicate("go on\n", timeout=30.0)
        finally:
            process.kill()
        assert process.returncode == 0


ENDING = """
import os, signal, sys
from vpsci_ros.runs.stop_request import stop_requested_by_signals

with stop_requested_by_signals(to_the_end=True) as stop:
    assert not stop.is_set()
os.kill(os.getpid(), signal.SIGINT)
os.kill(os.getpid(), signal.SIGTERM)
sys.exit(3)
"""


def test_a_signal_does_not_become_the_exit_status_of_a_process_that_is_at_its_end() -> None:
    done = subprocess.run([sys.executable, "-c", ENDING], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (3, "")


def test_a_block_of_which_a_half_is_worth_nothing_is_left_in_its_middle() -> None:
    begun = time.monotonic()
    with stop_requested_by_signals() as stop:
        with pytest.raises(Stopped), stop.at_once():
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(30.0)
        os.kill(os.getpid(), signal.SIGTERM)  # outside of it, a flag alone
        assert stop.is_set()
    assert time.monotonic() - begun < 20.0
