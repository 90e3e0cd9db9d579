"""A driving system behind a TCP socket on this machine's loopback: the exam in any language, without ROS.

The protocol is JSON, an object a line; docs/ads.md describes it (`A socket`), and examples/socket_ads.cpp speaks it.
Python and C++ read and write the numbers so that no bit is lost, and a system drives as the same one does as a Python
class.
"""

import contextlib
import dataclasses
import itertools
import json
import math
import socket
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.drivers import Begin, Driver, Observation
from vpsci_ros.exam.exam import EXTERNAL, Exam, prepare, require_lock_step, sealed
from vpsci_ros.exam.process import OWN, command_of, failure, running
from vpsci_ros.lockstep.engines import require_own
from vpsci_ros.runs.processes import ChildProcess
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.workers import HERE, Site

PORT = "VPSCI_ADS_PORT"  # environment variable in which a system that is started here finds the port
HELLO = {"type": "hello", "protocol": "vpsci-ads", "version": 1}
LONGEST = 65_536  # [bytes] of an answer
_LOOK = 0.2  # [s] between looks whether the system still runs
_SHOWN = 120  # characters of an answer in a message


class SocketDriver:
    """A driver of one car: the system at the other end of a connection, which is not reopened after a failure.

    :param connection: None: there is none, for the reason that `lost` gives.
    :param patience: for an answer [s].
    :param ended: how the system ended, in words; nothing while it runs.
    """

    def __init__(
        self, connection: socket.socket | None, patience: float, ended: Callable[[], str], lost: str = ""
    ) -> None:
        self._connection, self._patience, self._ended, self._lost = connection, patience, ended, lost
        self._ticks = itertools.count()
        self._received = b""

    def greet(self, period: float) -> None:
        """Send the protocol's name and version, and the length of a tick [s]."""
        with contextlib.suppress(InvalidInput):  # who has left already is lost at the first tick
            self._send(HELLO | {"period": period})

    def reset(self, begin: Begin) -> None:
        """Send the scenario, number, seed and lane of the episode that begins."""
        road = begin.scenario.vehicle
        lane = {"lane": road.path.points.tolist(), "lane_width": road.lane_width}
        episode = {"scenario": begin.scenario.number, "name": begin.scenario.name, "episode": begin.episode}
        self._send({"type": "reset"} | episode | {"seed": begin.seed} | lane)

    def act(self, observation: Observation) -> Any:
        """Send a tick and return the command that answers it.

        :raises InvalidInput: none came in time, the connection is lost, or it is no answer to this tick.
        """
        tick = next(self._ticks)
        curvttc = observation.curvttc if math.isfinite(observation.curvttc) else None
        seen = {"vehicle": observation.vehicle, "pedestrians": observation.pedestrians}
        rest = {"curvttc": curvttc, "distance": observation.distance}
        self._require_nothing_ahead()
        self._send({"type": "tick", "tick": tick, "time": observation.time} | seen | rest)
        line = self._line()
        with contextlib.suppress(ValueError, LookupError, TypeError, RecursionError):
            answer = json.loads(line)
            if answer["tick"] == tick:
                return answer["command"]
        raise InvalidInput(f'expected {{"tick": {tick}, "command": ...}}, got {line[:_SHOWN]!r}')

    def _send(self, message: dict[str, Any]) -> None:
        if self._connection is None:
            raise InvalidInput(self._lost)
        try:
            self._connection.settimeout(self._patience)
            self._connection.sendall(json.dumps(message, separators=(",", ":")).encode() + b"\n")
        except OSError as error:
            raise self._gone(f"it does not read ({error})") from None

    def _require_nothing_ahead(self) -> None:
        """Give a system up that has answered a tick which it has not been sent.

        :raises InvalidInput: it has.
        """
        if self._connection is None:
            return
        self._connection.setblocking(False)
        with contextlib.suppress(OSError):  # nothing there, or a connection that is lost, which sending shows
            self._received += self._connection.recv(LONGEST)
        if self._received:
            raise self._gone(
                f"it answered before it was sent the tick: {self._received[:_SHOWN].decode(errors='replace')!r}"
            )

    def _line(self) -> str:
        """Return the next line that the system sent.

        :raises InvalidInput: there was none in time, or it is too long.
        """
        deadline = time.monotonic() + self._patience
        while b"\n" not in self._received:
            if len(self._received) > LONGEST:
                raise self._gone(f"it sent more than {LONGEST} bytes without an end of line")
            if (left := deadline - time.monotonic()) <= 0.0:
                raise self._gone(f"no answer for {self._patience:g} s")
            assert self._connection is not None
            try:
                self._connection.settimeout(left)
                more = self._connection.recv(LONGEST)
            except TimeoutError:
                continue
            except OSError as error:
                raise self._gone(f"the connection broke ({error})") from None
            if not more:
                raise self._gone("it closed the connection")
            self._received += more
        line, _, self._received = self._received.partition(b"\n")
        return line.decode("utf-8", "replace")

    def _gone(self, reason: str) -> InvalidInput:
        """Close the connection and return why: an answer that came later would answer another tick."""
        if self._connection is not None:
            self._connection.close()
        time.sleep(_LOOK)  # a system that leaves may be about to end with other words
        self._connection, self._lost = None, self._ended() or reason
        return InvalidInput(self._lost)


def prepare_socket(sections: Sections, ads: str | None, port: int, workers: Site = HERE) -> Exam:
    """Return the exam of a program that connects to a port of 127.0.0.1.

    :param ads: its command, instead of the parameters' one; external: somebody else starts it.
    :param port: 0: a free one, which the program finds in its environment.
    :raises InvalidInput: see `prepare`, or the command and the port do not go together.
    """
    exam = prepare(sections.changed("ads_test", {"ads_class": ""}), ads, None, workers)
    command = exam.config.ads
    if command.strip() == OWN or (command == EXTERNAL) != (port > 0):
        raise InvalidInput(
            f"--port {port} with ads = {command}: give a command of your own with port 0, which it finds in its "
            "environment, or 'external' with the port to which you connect it"
        )
    require_lock_step(exam.simulator)
    require_own(exam.simulator.engine, "a program behind a socket drives")
    return sealed(dataclasses.replace(exam, driver=partial(connected, command, port, exam.world.tick)))


@contextlib.contextmanager
def connected(ads: str, number: int, period: float, log: Path, patience: float) -> Iterator[Callable[[], Driver]]:
    """Listen, start the system unless it is external, and yield a function that makes a driver of its connection.

    :param ads: command, or external.
    :param number: of the port; 0: a free one.
    :param period: of a tick [s].
    :param log: for what the system writes.
    :param patience: [s] until it has connected, and for each answer.
    :raises InvalidInput: the port cannot be had, or the program not be started.
    """
    with contextlib.ExitStack() as stack:
        try:
            server = stack.enter_context(socket.create_server(("127.0.0.1", number), backlog=1))
        except OSError as error:
            raise InvalidInput(f"--port {number}: cannot listen there ({error.strerror})") from None
        process = None
        port = server.getsockname()[1]
        if ads != EXTERNAL:
            process = stack.enter_context(running(command_of(ads), log, {PORT: str(port)}))

        def ended() -> str:
            return failure(process) if process else ""

        connection = _accepted(server, process, patience)
        if connection is None:
            yield lambda: SocketDriver(None, patience, ended, ended() or f"it did not connect for {patience:g} s")
            return
        stack.enter_context(connection)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        driver = SocketDriver(connection, patience, ended)
        driver.greet(period)
        yield lambda: driver


def _accepted(server: socket.socket, process: ChildProcess | None, patience: float) -> socket.socket | None:
    """Return the first connection; None where none came in time, or the system has ended."""
    deadline = time.monotonic() + patience
    server.settimeout(_LOOK)
    while time.monotonic() < deadline and not (process and process.end):
        with contextlib.suppress(TimeoutError):
            return server.accept()[0]
    return None
