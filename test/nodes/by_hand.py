"""Nodes started one by one as processes, as a user does, and what their bag holds."""

import signal
import subprocess
import sys
from pathlib import Path

import yaml
from nodes.stage import PATIENCE
from rosbags.highlevel import AnyReader

from vpsci_ros.nodes.graph import resolve
from vpsci_ros.parameters import as_ros_parameters
from vpsci_ros.runs.config import Sections


class ByHand:
    """Processes of one graph, by a parameter file or by sections as `vpsci_ros.cli.parameter_file` reads them."""

    def __init__(self, folder: Path, parameters: Sections | Path, namespace: str = "") -> None:
        self.folder, self._namespace = folder, namespace
        folder.mkdir(parents=True, exist_ok=True)
        if isinstance(parameters, Path):
            self._parameters = parameters
        else:
            self._parameters = folder / "params.yaml"
            layout = as_ros_parameters(resolve(parameters, folder).values, any_namespace=bool(namespace))
            self._parameters.write_text(yaml.safe_dump(layout), encoding="utf-8")
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, *nodes: str, extra: tuple[str, ...] = ()) -> None:
        """Start nodes; "world_simulator,recorder" is one process, and goes by the name of the first."""
        for names in nodes:
            node = names.partition(",")[0]
            command = [sys.executable, "-m", "vpsci_ros.nodes", names, "--ros-args"]
            command += ["--params-file", str(self._parameters)]
            command += ["-r", f"__ns:={self._namespace}"] * bool(self._namespace)
            with open(self.folder / f"{node}.log", "ab") as log:
                self.running[node] = subprocess.Popen([*command, *extra], stdout=log, stderr=subprocess.STDOUT)

    def log(self, node: str) -> str:
        """Return what a node has said so far."""
        return (self.folder / f"{node}.log").read_text()

    def finish(self, first: str = "world_simulator") -> Path:
        """Wait for the end of `first`, stop the others, the recorder last; return the bag."""
        assert self.running[first].wait(PATIENCE) == 0, self.log(first)
        for node in sorted(self.running, key=lambda name: name == "recorder"):
            if self.running[node].poll() is None:
                self.running[node].send_signal(signal.SIGINT)
                assert self.running[node].wait(PATIENCE) == 0, self.log(node)
        return self.folder / "bag"

    def close(self) -> None:
        """End whatever is left."""
        for process in self.running.values():
            if process.poll() is None:
                process.kill()
            process.wait(PATIENCE)


def content(bag: Path) -> dict[tuple[str, int], list[bytes]]:
    """Return what a bag holds by topic and time, without `/diagnostics`, which tell of the machine.

    Serialized again, since the middleware leaves whatever it finds in the bytes that align the fields.
    """
    held: dict[tuple[str, int], list[bytes]] = {}
    with AnyReader([bag]) as reader:
        for connection, at, data in reader.messages():
            if connection.topic != "/diagnostics":
                message = reader.deserialize(data, connection.msgtype)
                whole = bytes(reader.typestore.serialize_cdr(message, connection.msgtype))
                held.setdefault((connection.topic, at), []).append(whole)
    return held
