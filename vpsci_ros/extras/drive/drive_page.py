"""The page of `vpsci drive`: its HTML, the data of a tick that it shows, and the keys that the person presses."""

import math
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.drive.server import Server
from vpsci_ros.report import html
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH
from vpsci_ros.view.view_page import SCENE, ground, inlined
from vpsci_ros.wire.layout import PlanarMotion
from vpsci_ros.world import Scenario

LOOK = 0.2  # [s] after which a wait goes on: without a limit, Ctrl-C may reach another thread and wake nobody
TEMPLATES = Path(__file__).resolve().parent / "templates"


class Left(InvalidInput):
    """Raised when the person has closed the page, begins the episode again, or has finished."""


class Pressed(NamedTuple):
    """The pressed keys as steer -1 (right) to 1 (left), accelerator and brake 0 to 1."""

    steer: float = 0.0
    throttle: float = 0.0
    brake: float = 0.0


class Page:
    """The page of one server, and the input of the person who uses it.

    :param folder: see `Server`, as `port` is.
    :ivar pressed: at present.
    :ivar finished: the person wants no further episode.
    """

    def __init__(self, folder: Path, port: int = 0) -> None:
        self.pressed, self.finished = Pressed(), False
        self._ready, self._gone, self._changed = False, "", threading.Condition()
        script = inlined(*SCENE) + (TEMPLATES / "drive.js").read_text(encoding="utf-8")
        text = html.page(
            TEMPLATES / "drive.html", connect=True, title="Drive", style=inlined("view.css"), script=script
        )
        self._server = Server(text, folder, self._hear, port)
        self.address, self.send = self._server.address, self._server.send

    def close(self) -> None:
        """Stop the server; this also ends a wait for the person."""
        self._hear({"finish": True})
        self._server.close()

    def begin(self, name: str, scenario: Scenario, which: str) -> None:
        """Show the scene of an episode; `which` describes the episode in words."""
        with self._changed:
            self._ready, self._gone, self.pressed = False, "", Pressed()
        size = [VEHICLE_LENGTH, VEHICLE_WIDTH, PEDESTRIAN_RADIUS]
        self.send("episode", name=name, which=which, scenario=scenario.name, ground=ground(scenario), size=size)

    def show(self, time: float, vehicle: PlanarMotion, people: Sequence[PlanarMotion]) -> None:
        """Show a tick: time since the spawn [s], and all positions."""
        seen = {"time": time, "x": vehicle.x, "y": vehicle.y, "heading": vehicle.yaw, "speed": vehicle.speed}
        seen["curvature"] = vehicle.yaw_rate / vehicle.speed if vehicle.speed > 0.0 else 0.0
        walk = [(each.x, each.y, each.speed * math.cos(each.yaw), each.speed * math.sin(each.yaw)) for each in people]
        self.send("frame", people=walk, **seen)

    def wait_until_ready(self) -> None:
        """Wait until the person begins the episode.

        :raises Left: the person has finished instead.
        """
        with self._changed:
            while not (self._ready or self.finished):
                self._changed.wait(LOOK)
            self._gone = ""  # whoever has closed the page meanwhile is there again
        self.require_person()

    def wait(self, until: float) -> None:
        """Wait until a time of `time.monotonic`, or until the person has left the page."""
        with self._changed:
            self._changed.wait_for(lambda: bool(self._gone) or self.finished, max(0.0, until - time.monotonic()))

    def require_person(self) -> None:
        """Raise `Left` unless a person is at the page.

        :raises Left: there is none.
        """
        if self.finished:
            raise Left("the person has finished")
        if self._gone:
            raise Left(self._gone)

    def wait_until_left(self, patience: float) -> None:
        """Wait until the page has been closed for `patience` seconds; a reload counts as open."""
        while True:
            while self._server.visited:
                time.sleep(LOOK)
            time.sleep(patience)
            if not self._server.visited:
                return

    def _hear(self, message: dict[str, Any] | None) -> None:
        with self._changed:
            if message is None:
                self._gone, self._ready = "the page was closed", False
            elif message.get("ready") is True:
                self._ready = True
            elif message.get("again") is True:
                self._gone = "the person begins it again"
            elif message.get("finish") is True:
                self.finished = True
            else:
                self.pressed = _pressed(message.get("pressed")) or self.pressed
            self._changed.notify_all()


def _pressed(values: Any) -> Pressed | None:
    """Return what is pressed; None where a page says something else."""
    if not isinstance(values, list) or len(values) != 3:
        return None
    if not all(isinstance(value, (int, float)) and -math.inf < value < math.inf for value in values):
        return None
    steer, throttle, brake = values
    return Pressed(min(max(steer, -1.0), 1.0), min(max(throttle, 0.0), 1.0), min(max(brake, 0.0), 1.0))
