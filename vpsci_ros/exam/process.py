"""The process of a driving system: a program that a command line names, or a class, which answers scenes there.

A class may end its process, leave threads and copies of it, change the folder, or write into what it is shown. The exam
has its answers as JSON through a connection, one to each scene, and knows how the process ended.
"""

import contextlib
import importlib
import inspect
import itertools
import json
import multiprocessing
import os
import shlex
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import vpsci_ros
from vpsci_ros.documents import printable
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.exam.drivers import Answer, Cockpit, Driver, Scene, log_name, received_answer
from vpsci_ros.runs.files import sha256
from vpsci_ros.runs.processes import STEPS, ChildProcess, stop
from vpsci_ros.world import Scenario

OWN = "example_ads"
_MAIN = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[3]); from vpsci_ros.exam.process import main; "
    "main(int(sys.argv[1]), sys.argv[2])"
)
_LOOK = 0.2  # [s] between looks whether the process still runs
_LONGEST = 2**20  # [bytes] of an answer
_NUMBER = 8  # [bytes] before each message of the process: how many it has sent before
_STARTS = 60.0  # [s] at least, that the process has to import the module, and to make its objects
_LEAVES = 1.0  # [s] that the process has to end by itself


def command_of(text: str, latency: float | None = None) -> list[str]:
    """Split a command line into program and arguments, without a shell; `example_ads` is the package's example.

    :param latency: of the objects [s] that `example_ads` has to do with; None: it has odometry.
    :raises InvalidInput: quotes that do not close, or a program that is not there.
    """
    if text.strip() == OWN:
        objects = ["--ros-args", "-p", "objects:=true", "-p", f"objects_latency:={latency or 0.0:.6f}"]
        return [sys.executable, "-m", f"vpsci_ros.nodes.{OWN}", *(objects if latency is not None else ())]
    try:
        command = shlex.split(text)
    except ValueError as error:
        raise InvalidInput(f"--ads {text!r}: not a command line ({error})") from None
    if not command or shutil.which(command[0]) is None:
        raise InvalidInput(
            f"--ads {text!r}: no program {command[0] if command else ''!r} on the path; give a command such as "
            "'python my_ads.py' or 'ros2 run my_package my_ads', or 'external' to start it yourself"
        )
    return command


def files_of(text: str) -> dict[str, str]:
    """Return name -> SHA-256 of the files that a command line names."""
    own = [Path(__file__).parents[1] / "nodes" / name for name in (f"{OWN}.py", "example_driver.py")]
    words = own if text.strip() == OWN else map(Path, shlex.split(text))
    return {word.name: sha256(word) for word in words if word.is_file()}


@contextlib.contextmanager
def running(command: list[str], log: Path, added: Mapping[str, str] | None = None) -> Iterator[ChildProcess]:
    """Start the driving system; stop it and its children at the end of the `with` block.

    :param added: variables of its environment, besides those of this process.
    :raises InvalidInput: the program cannot be started.
    """
    try:
        process = ChildProcess(command, log, _environment() | dict(added or {}))
    except OSError as error:
        raise InvalidInput(f"--ads {shlex.join(command)}: cannot be started ({error.strerror})") from error
    with _stopped(process):
        yield process


@contextlib.contextmanager
def _stopped(process: ChildProcess, steps: Sequence[tuple[signal.Signals, float]] = STEPS) -> Iterator[None]:
    try:
        yield
    finally:
        stop([process], steps)
        process.signal(signal.SIGKILL)  # for what it started and left behind


def failure(process: ChildProcess) -> str:
    """Return how the driving system ended, with its last output line; "" while it runs."""
    if not process.end:
        return ""
    said = process.said()
    return f"the ADS {process.end}" + (f", having said {said!r}" if said else "") + f" (log: {log_name(process.log)})"


def _environment() -> dict[str, str]:
    """Return the environment of the ADS: as this process was given it, before Python's ROS 2 wheels changed it."""
    environment = dict(os.environ)
    environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    libraries = environment.pop("LD_LIBRARY_PATH", "").split(os.pathsep)
    if own := [path for path in libraries if path and not Path(path).is_relative_to(sys.prefix)]:
        environment["LD_LIBRARY_PATH"] = os.pathsep.join(own)
    return environment


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
        """Create an object of the class for each car in the process, see `Cockpit`; earlier objects are gone.

        :raises InvalidInput: it cannot be made.
        """
        self._send((scenarios, cars, spawn))
        self._first("while its objects were made")

    def answers(self, scenes: Sequence[Scene]) -> Iterator[Answer]:
        """Yield the answer to each scene, in their order; after the process has ended, each answer is an error."""
        self._send(scenes)
        for _ in scenes:
            yield self._answer()

    def _send(self, what: Any) -> None:
        with contextlib.suppress(OSError):  # it has ended, which reading from it shows
            self._connection.send(what)

    def _answer(self) -> Answer:
        if not self._ended:
            try:
                return received_answer(self._received(self._patience))
            except InvalidInput as error:
                self._ended = str(error)
            except (ValueError, RecursionError):
                self._ended = self._ended or "its process sent what is no JSON"
            self._process.signal(signal.SIGKILL)
        return Answer(error=self._ended)

    def _received(self, patience: float) -> Any:
        """Return what the process says next.

        :raises ValueError: the message is no JSON; or there is none that was asked for, and `_ended` says why.
        """
        deadline = time.monotonic() + patience
        while not self._connection.poll(_LOOK):
            if self._process.end and not self._connection.poll(0.0):
                raise self._over(self._how())
            if time.monotonic() > deadline:
                raise self._over(f"no answer for {patience:g} s")
        try:
            said = self._connection.recv_bytes(_LONGEST)
        except (EOFError, OSError):
            self._process.wait(_LEAVES)
            raise self._over(self._how() or "its process closed the connection") from None
        if said[:_NUMBER] != _number(self._heard):
            raise self._over("its process sent an answer that it was not asked for")
        self._heard += 1
        return json.loads(said[_NUMBER:])

    def _over(self, why: str) -> ValueError:
        self._ended = why
        return ValueError(why)

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
        with _stopped(process, ((signal.SIGTERM, _LEAVES), (signal.SIGKILL, _LEAVES))):
            yield ClassProcess(process, here, patience)
            here.close()
            process.wait(_LEAVES)


def files_of_class(text: str) -> dict[str, str]:
    """Return name -> SHA-256 of the modules of the working directory that the class MODULE:CLASS needs, by their paths.

    A class that is defined elsewhere adds the file that defines it, by its name; there may be none.

    :raises InvalidInput: there is no such class, or it is no driver.
    """
    path, imported = _found(text)
    files = {str(module.relative_to(Path.cwd())): module for module in imported}
    if path not in imported:
        files[path.name] = path
    return {name: sha256(path) for name, path in sorted(files.items()) if path.is_file()}


def code_of_class(text: str) -> list[Path]:
    """Return the files of the working directory that the class MODULE:CLASS needs: modules, and all of its packages.

    :raises InvalidInput: there is no such class, or it is no driver.
    """
    here = Path.cwd()
    modules = [path for path in _found(text)[1] if path.is_file() and path.is_relative_to(here)]
    packages = {here / path.relative_to(here).parts[0] for path in modules if path.parent != here}
    inside = [path for package in packages for path in package.rglob("*") if path.is_file()]
    return sorted({path for path in (*modules, *inside) if "__pycache__" not in path.parts})


def _found(text: str) -> tuple[Path, list[Path]]:
    """Return the file that defines a class, and the files of the working directory that its module imports."""
    with tempfile.TemporaryDirectory() as folder, class_process(text, Path(folder) / "log", _STARTS) as process:
        return Path(process.path), process.imported


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
        if error.__cause__:
            traceback.print_exception(error.__cause__)  # of the driver's code, into the log
        say({"refused": str(error)})
    except (EOFError, OSError):
        pass  # the exam is over
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(Exception):
                stream.flush()
        if sys.exc_info()[0] is None:
            os._exit(0)  # without waiting for threads that the class has left


def find_driver(text: str) -> type[Driver]:
    """Return the class that MODULE:CLASS names; MODULE is installed or lies in the working directory.

    :raises InvalidInput: another form, no such module or class, one that cannot be imported, or no driver.
    """
    where = f"--ads-class {text!r}"
    module, _, name = text.partition(":")
    if not module or not name.isidentifier():
        raise InvalidInput(f"{where}: expected MODULE:CLASS, such as my_driver:MyDriver")
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise InvalidInput(f"{where}: {module} cannot be imported: {error}") from error
        raise InvalidInput(
            f"{where}: no module {error.name!r}; install it, or run the command in the folder in which it is"
        ) from None
    except SystemExit as error:
        raise InvalidInput(
            f"{where}: {module} ends the program while it is imported (SystemExit: {error}); put its main under "
            "if __name__ == '__main__'"
        ) from error
    except BaseException as error:
        raise InvalidInput(f"{where}: {module} cannot be imported: {type(error).__name__}: {error}") from error
    driver = getattr(found, name, None)
    if not isinstance(driver, type):
        own = [key for key, value in vars(found).items() if isinstance(value, type) and value.__module__ == module]
        raise InvalidInput(f"{where}: {module} has no class {name!r}; it has {', '.join(own) or 'none'}")
    if missing := [method for method in ("reset", "act") if not callable(getattr(driver, method, None))]:
        raise InvalidInput(f"{where}: it has no {' and no '.join(missing)}; define reset(begin) and act(observation)")
    return driver


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
