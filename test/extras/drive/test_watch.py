"""A running graph in the page: what `/world/state` shows."""

import asyncio
import itertools
import threading
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from page_client import said, visited
from rclpy.context import Context

from vpsci_msgs.msg import WorldState
from vpsci_ros.extras.drive.drive_page import Page
from vpsci_ros.extras.drive.watch import watch_graph
from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.wire.header import WireHeader
from vpsci_ros.wire.world_state import StateContent, write_world_state
from vpsci_ros.world.scenario import shipped_scenarios
from vpsci_ros.world.state import EPISODE, RUNNING
from vpsci_ros.world.tick import Tick


def state(frame: int) -> bytes:
    """Return a WorldState of two slots: an idle one, and episode 5:7 in which a contact is 2 s ahead."""
    rows = np.zeros(2, EPISODE)
    row = rows[1]
    row["scenario"], row["episode"], row["frame"], row["status"], row["pedestrians"] = 5, 7, frame, RUNNING, 1
    row["vehicle_speed"], row["pedestrian_x"] = 5.0, 10.0 + 4.69 / 2.0 + 0.3
    return write_world_state(StateContent(WireHeader(0, 0, "map"), Tick(frame, rows, np.zeros(2, bool)), 0.05))


def test_the_page_shows_the_episode_that_runs_with_its_road_and_its_curvttc(tmp_path: Path) -> None:
    async def publish(publisher: Any) -> None:
        for frame in itertools.count():
            publisher.publish(state(frame))
            await asyncio.sleep(0.05)

    async def seen(address: str, publisher: Any) -> list[dict[str, Any] | None]:
        async with visited(address) as page:
            found = [await said(page)]
            publishing = asyncio.create_task(publish(publisher))  # what comes before the page has found it is lost
            found += [await said(page), await said(page)]
            publishing.cancel()
            return found

    context = Context()
    with own_domain(), closing(Page(tmp_path, "watch")) as page:
        watching = threading.Thread(target=watch_graph, args=[page, shipped_scenarios()], daemon=True)
        watching.start()
        rclpy.init(context=context)
        node = rclpy.create_node("graph", context=context)
        try:
            publisher = node.create_publisher(WorldState, "world/state", 10)
            hello, episode, frame = asyncio.run(seen(page.address, publisher))
        finally:  # nothing of it stays in a domain that is another test's next
            node.destroy_node()
            context.shutdown()
    watching.join(60.0)
    assert not watching.is_alive()
    assert hello == {"type": "hello", "mode": "watch"}
    assert episode is not None
    assert (episode["name"], episode["scenario"]) == ("5:7", "LocationB_PedCross_S-N")
    assert len(episode["ground"]["crosswalk"]) >= 4
    assert frame is not None
    assert abs(frame["curvttc"] - 2.0) < 1e-3
    assert frame["speed"] == 5.0
