"""Executables are found by the names of nodes, and a Ctrl-C is heard from their beginning on."""

import subprocess
import sys

import pytest

from vpsci_ros.nodes import entry

INTERRUPTED = """
import os, signal, sys
class Interrupting:
    def find_spec(self, name, *_):
        if name == "vpsci_ros.nodes.intake":  # somewhere on the way
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
from vpsci_ros.nodes.entry import safety_monitor
sys.exit(safety_monitor())
"""


def test_ctrl_c_while_a_node_imports_ends_it_without_a_traceback() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_there_is_no_executable_of_another_name() -> None:
    assert callable(entry.replayer)
    with pytest.raises(AttributeError, match="has no attribute 'replayr'"):
        entry.replayr  # noqa: B018
