"""A driving system's class in its own process, so that its crashes do not end the exam.

It may end its process, leave threads and copies of it, change the folder, or write into what it is shown. The exam has
its answers as JSON through a connection, one to each scene, and knows how the process ended.
"""

import contextlib
import inspect
import itertools
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import vpsci_ros
from vpsci_ros.documents import printable
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.exam.driver_class import Answer, Cockpit, Scene, find_driver, received_answer
from vpsci_ros.exam.process import failure, log_name
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.processes import ChildProcess, stop
from vpsci_ros.world import Scenario

_MAIN = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[3]); from vpsci_ros.exam.class_process import main; "
    "main(int(sys.argv[1]), sys.argv[2])"
)
_LOOK = 0.2  # [s] between looks whether the process still runs
_LONGEST = 2**20  # [bytes] of an answer
_NUMBER = 8  # [bytes] before each message of the process: how many it has sent before
_STARTS = 60.0  # [s] at least, that the process has to import the module, and to make its objects
_LEAVES = 1.0  # [s] that the process has to end by itself


class ClassProcess:
    """The process in which a driving system's class answers.

    :param patience: for an answer [s].
    :ivar path: of the file that defines the class, as the process gives it; empty: there is none.
    :ivar imported: files of the working directory that the module has imported, as the process gives them.
    :raises InvalidInput: the class cannot be found or made.
    """

    def __init__(self, process: ChildProcess, connection: Connection, patience: float) -> None:
        self._process, self._connection, self._patience = process, connection, patience
        self._ended, self.imported, self._heard = "", list[Path](), 0
        self.path: str = self._first("while its module was imported")

    def make_drivers(self, scenarios: Sequence[Scenario], cars: int, spawn: str) -> None:
        """Create an object of the class for each car in the process, see `Cockpit`.

        :raises InvalidInput: it cannot be made.
        """
        with contextlib.suppress(OSError):  # it has ended, which reading from it shows
            self._connection.send((scenarios, cars, spawn))
        self._first("while its objects were made")

    def answers(self, scenes: Sequence[Scene]) -> Iterator[Answer]:
        """Yield the answer to each scene, in their order; after the process has ended, each answer is an error."""
        with contextlib.suppress(OSError):
            self._connection.send(scenes)
        for _ in scenes:
            yield self._answer()

    def _answer(self) -> Answer:
        if not self._ended:
            try:
                return received_answer(self._received(self._patience))
            except InvalidInput as error:
                self._give_up(str(error))
            except (ValueError, RecursionError):
                self._give_up("its process sent what is no JSON")
        return Answer(error=self._ended)

    def _give_up(self, why: str) -> None:
        """Kill the process; `_ended` says why, unless it is known already."""
        self._ended = self._ended or why
        self._process.signal(signal.SIGKILL)

    def _received(self, patience: float) -> Any:
        """Return what the process says next.

        :raises ValueError: the message is no JSON; or there is none that was asked for, and `_ended` says why.
        """
        deadline = time.monotonic() + patience
        while not self._connection.poll(_LOOK):
            if self._process.end and not self._connection.poll(0.0):
                self._ended = self._how()
                raise ValueError
            if time.monotonic() > deadline:
                self._ended = f"no answer for {patience:g} s"
                raise ValueError
        try:
            said = self._connection.recv_bytes(_LONGEST)
        except (EOFError, OSError):
            self._process.wait(_LEAVES)
            self._ended = self._how() or "its process closed the connection"
            raise ValueError from None
        if said[:_NUMBER] != _number(self._heard):
            self._ended = "its process sent an answer that it was not asked for"
            raise ValueError
        self._heard += 1
        return json.loads(said[_NUMBER:])

    def _how(self) -> str:
        """Return how the process ended; nothing while it runs."""
        return failure(self._process).removesuffix(f" (log: {log_name(self._process.log)})")

    def _first(self, when: str) -> Any:
        """Return what the process says before it is asked anything.

        :raises InvalidInput: it has refused the class, or has ended.
        """
        found: Any = None
        with contextlib.suppress(ValueError, RecursionError):
            found = self._received(max(_STARTS, self._patience))
        match found:
            case {"refused": str(reason)}:
                raise InvalidInput(printable(reason))
            case {"path": str(path), "imported": [*files]}:
                self.imported = [Path(str(file)) for file in files]
                return path
            case {} if isinstance(found, dict) and not found:
                return ""
        raise InvalidInput(f"--ads-class: {when}, {self._ended or 'its process sent what it may not'}")


@contextlib.contextmanager
def class_process(text: str, log: Path, patience: float) -> Iterator[ClassProcess]:
    """Start a process for the class MODULE:CLASS; stop it and its children at the end of the `with` block.

    :param log: for what it writes.
    :raises InvalidInput: the class cannot be found.
    """
    here, there = multiprocessing.Pipe()
    command = [sys.executable, "-P", "-c", _MAIN, str(there.fileno()), text, json.dumps(sys.path)]
    with here:
        with there:
            process = ChildProcess(command, log, os.environ, inherited=[there.fileno()])
        try:
            yield ClassProcess(process, here, patience)
            here.close()
            process.wait(_LEAVES)
        finally:
            stop([process], ((signal.SIGTERM, _LEAVES), (signal.SIGKILL, _LEAVES)))
            process.signal(signal.SIGKILL)  # for what it started and left behind


def files_of_class(text: str) -> dict[str, str]:
    """Return name -> SHA-256 of the modules of the working directory that the class MODULE:CLASS needs, by their paths.

    A class that is defined elsewhere adds the file that defines it, by its name; there may be none.

    :raises InvalidInput: there is no such class, or it is no driver.
    """
    with tempfile.TemporaryDirectory() as folder, class_process(text, Path(folder) / "log", _STARTS) as process:
        files = {str(path.relative_to(Path.cwd())): path for path in process.imported}
        if (path := Path(process.path)) not in process.imported:
            files[path.name] = path
    return {name: sha256(path) for name, path in sorted(files.items()) if path.is_file()}


def code_of_class(text: str) -> list[Path]:
    """Return the files of the working directory that the class MODULE:CLASS needs: modules, and all of its packages.

    :raises InvalidInput: there is no such class, or it is no driver.
    """
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder, class_process(text, Path(folder) / "log", _STARTS) as process:
        modules = [path for path in process.imported if path.is_file() and path.is_relative_to(here)]
    packages = {here / path.relative_to(here).parts[0] for path in modules if path.parent != here}
    inside = [path for package in packages for path in package.rglob("*") if path.is_file()]
    return sorted({path for path in (*modules, *inside) if "__pycache__" not in path.parts})


def main(descriptor: int, text: str) -> None:
    """Run the main loop of the class's process: answer scenes until the connection ends."""
    connection, own, said = Connection(descriptor), os.getpid(), itertools.count()

    def say(what: Any) -> None:
        if os.getpid() != own:
            os._exit(0)  # a copy of this process, which the class has made and which came back here
        connection.send_bytes(_number(next(said)) + json.dumps(what).encode())

    try:
        before = set(sys.modules)
        driver = find_driver(text)
        say({"path": _source(driver), "imported": _of_working_directory(sys.modules.keys() - before)})
        while True:
            asked = connection.recv()
            if isinstance(asked, tuple):
                cockpit = Cockpit(driver, *asked)
                say({})
                continue
            for answer in cockpit.answers(asked):
                say(answer)
    except VpsciError as error:
        say({"refused": str(error)})
    except (EOFError, OSError):
        pass  # the exam is over
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(Exception):
                stream.flush()
        if sys.exc_info()[0] is None:
            os._exit(0)  # without waiting for threads that the class has left


def _number(messages: int) -> bytes:
    return messages.to_bytes(_NUMBER, "big")


def _of_working_directory(modules: Iterable[str]) -> list[str]:
    """Return the files of those modules that lie in the working directory, and are not installed in it."""
    here, files = Path.cwd(), (getattr(sys.modules[name], "__file__", None) for name in modules)
    own = {Path(file) for file in files if isinstance(file, str)}
    mine = [path for path in own if path.is_relative_to(here) and not path.is_relative_to(sys.prefix)]
    return [str(path) for path in mine if not path.is_relative_to(Path(vpsci_ros.__file__).parent)]


def _source(driver: type) -> str:
    with contextlib.suppress(TypeError, OSError):
        return inspect.getsourcefile(driver) or ""
    return ""
