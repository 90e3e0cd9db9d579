"""A running graph, shown live in the page: the states of `/world/state` at a rate for human viewers."""

import time

from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.driver_class import as_odometry
from vpsci_ros.extras.drive.drive_page import Page
from vpsci_ros.nodes.live import subscribe_to_graph
from vpsci_ros.wire.layout import WORLD
from vpsci_ros.wire.world_state import read_world_state
from vpsci_ros.world import IDLE, Scenario
from vpsci_ros.world.monitor import assess

EYES = 0.04  # [s] between two frames


def watch_graph(page: Page, scenarios: list[Scenario]) -> None:
    """Show the episode of the first busy slot of the graph in this ROS domain, until `Page.close`.

    :param scenarios: where its episodes may take place.
    """
    seen = Seen(page, {scenario.number: scenario for scenario in scenarios})
    subscribe_to_graph(WORLD, seen.take, lambda: page.finished)


class Seen:
    """Shows a graph's states in the page, at most one every `EYES` seconds."""

    def __init__(self, page: Page, roads: dict[int, Scenario]) -> None:
        self._page, self._roads = page, roads
        self._episode = (0, 0)
        self._next = 0.0

    def take(self, message: bytes) -> None:
        """Show a message, unless another one was shown less than `EYES` seconds before.

        :raises InvalidInput: its episode takes place in a scenario of which nothing is known.
        """
        if time.monotonic() < self._next:
            return
        self._next = time.monotonic() + EYES
        world = read_world_state(message, WORLD)
        present = world.tick.state[world.tick.state["status"] != IDLE]
        if not len(present):
            return
        key = int(present["scenario"][0]), int(present["episode"][0])
        rows = present[(present["scenario"] == key[0]) & (present["episode"] == key[1])]
        if key != self._episode:
            if key[0] not in self._roads:
                raise InvalidInput(f"the graph drives scenario {key[0]}; name its file in scenario_files")
            self._page.begin(f"{key[0]}:{key[1]}", self._roads[key[0]], f"episode {key[0]}:{key[1]}")
            self._episode = key
        curvttc, _, _ = assess(rows)
        nearest = int(curvttc.argmin())
        people = [as_odometry(rows[k], "pedestrian") for k in (nearest, *(k for k in range(len(rows)) if k != nearest))]
        self._page.show(
            int(rows["frame"][0]) * world.period, as_odometry(rows[0], "vehicle"), people, float(curvttc[nearest])
        )
