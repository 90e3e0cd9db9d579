"""A process with the imports of nodes and of driving systems' classes; tests fork theirs from it.

Imports and numba's first kernel take 0.8 s of a processor in each process. The fork server imports nothing of ROS: its
libraries start threads, which a fork would lose.
"""

import ctypes
import importlib
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from vpsci_ros.runs.processes import ChildProcess

LARGEST = 2**18  # [bytes] of a request: the arguments of a process and its environment
PRELOADED = (
    *("nodes.node_config", "nodes.convert", "nodes.failures"),
    *("bags.ticks", "exam.process", "policy.agent", "world.loop", "world.perception"),
)
PR_SET_PDEATHSIG = 1


class ForkServer:
    """The test's end: requests forks, and how they have ended."""

    def __init__(self) -> None:
        self._channel, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with other:
            command = [sys.executable, "-u", __file__, str(other.fileno())]
            environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # no threads of numpy's
            files = [other.fileno()]
            self._process = subprocess.Popen(command, pass_fds=files, start_new_session=True, env=environment)

    def request(self, what: Mapping[str, Any], files: Sequence[int] = ()) -> Any:
        """Return the reply to a request that file descriptors go along with."""
        socket.send_fds(self._channel, [json.dumps(what).encode()], files)
        return json.loads(self._channel.recv(LARGEST))

    def close(self) -> None:
        """End it; nodes that still run get SIGTERM."""
        self._channel.close()
        self._process.wait()


class ForkedProcess(ChildProcess):
    """A forked process in place of the child process of `python OPTION... -m MODULE` or `-c CODE`, and arguments."""

    def __init__(
        self,
        server: ForkServer,
        command: Sequence[str],
        log: Path,
        environment: Mapping[str, str],
        *,
        holds_signals: bool = False,
        inherited: Collection[int] = (),
    ) -> None:
        self.log, self._server, self._status = log, server, None
        begin = next(place for place, word in enumerate(command) if word in ("-m", "-c"))
        request = {"program": command[begin:], "folder": str(Path.cwd()), "environment": dict(environment)}
        request |= {"holds_signals": holds_signals, "numbers": inherited}
        with open(log, "ab") as output:
            self.pid = server.request(request, [output.fileno(), *inherited])

    @property
    def status(self) -> int | None:
        """As a child's."""
        if self._status is None:
            self._status = self._server.request({"ended": self.pid})
        return self._status

    def wait(self, seconds: float) -> None:
        """Wait for its end, so long at most."""
        deadline = time.monotonic() + seconds
        while self.status is None and time.monotonic() < deadline:
            time.sleep(0.01)


def serve(channel: socket.socket) -> list[str]:
    """Fork on request until the test's end is closed; return in each child, with the program and its arguments."""
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))  # until a node takes them
    for name in PRELOADED:
        importlib.import_module(f"vpsci_ros.{name}")
    load_kernels()
    assert len(list(Path("/proc/self/task").iterdir())) == 1, "threads would be lost in a fork"
    while True:
        text, files, _, _ = socket.recv_fds(channel, LARGEST, 8)
        if not text:
            sys.exit()
        request = json.loads(text)
        if "ended" in request:
            pid, status = os.waitpid(request["ended"], os.WNOHANG)
            reply = os.waitstatus_to_exitcode(status) if pid else None
        else:
            group, made = os.pipe()
            if not (reply := os.fork()):
                os.setsid()
                for file in (made, group, channel.detach()):
                    os.close(file)
                become(request, files)
                return list(request["program"])
            os.close(made)
            os.read(group, 1)  # its end: there is a process group, to which signals go
            for file in (group, *files):
                os.close(file)
        channel.send(json.dumps(reply).encode())


def become(request: Mapping[str, Any], files: Sequence[int]) -> None:
    """Take the folder, the environment, the log, the other files and the signals of the requested process."""
    os.chdir(request["folder"])
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.path[:0] = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path not in sys.path]
    for file, number in zip([files[0], *files], [1, 2, *request["numbers"]], strict=True):
        os.dup2(file, number)
    if not request["holds_signals"]:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT, signal.SIGTERM))


def load_kernels() -> None:
    """Take a step in a world, so that numba is ready."""
    from vpsci_ros.world import World, WorldConfig, load_scenarios
    from vpsci_ros.world.loop import Loop

    config = WorldConfig(vehicle_driver="autopilot", pedestrian_driver="autopilot", pedestrians=3)
    next(iter(Loop(World(config, load_scenarios([1]), [(1, 0)], 1, 0))))


if __name__ == "__main__":
    option, program, *sys.argv[1:] = serve(socket.socket(fileno=int(sys.argv[1])))
    if option == "-m":
        runpy.run_module(program, run_name="__main__")
    exec(program, {"__name__": "__main__"})
