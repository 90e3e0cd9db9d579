"""A running graph in Foxglove: a client of the SDK's WebSocket gets the graph's messages, byte by byte."""

import asyncio
import itertools
import json
import struct
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from typing import Any

import pytest

pytest.importorskip("foxglove", reason="pip install 'vpsci_ros[drive]'")

import rclpy
from rclpy.context import Context
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from tornado.websocket import WebSocketClientConnection, websocket_connect

from vpsci_msgs.msg import SafetyState
from vpsci_ros.extras.drive.foxglove_view import FoxgloveView
from vpsci_ros.nodes.domain import own_domain
from vpsci_ros.nodes.live import SHOWN
from vpsci_ros.nodes.topics import TOPICS

PROTOCOL = "foxglove.sdk.v1"


async def next_of(client: WebSocketClientConnection) -> Any:
    """Return the next message but those of the time: JSON, or subscription, log time [ns] and payload."""
    while (data := await asyncio.wait_for(client.read_message(), 60.0)) is not None:
        if isinstance(data, str):
            return json.loads(data)
        if data[0] == 1:
            return (*struct.unpack_from("<IQ", data, 1), data[13:])
    raise AssertionError("closed")


@asynccontextmanager
async def subscribed(
    address: str, *topics: str
) -> AsyncIterator[tuple[WebSocketClientConnection, dict[str, dict[str, Any]]]]:
    """Yield a client that has subscribed to topics (subscription: their place), and what channels it was offered."""
    client = await websocket_connect(address, subprotocols=[PROTOCOL])
    assert (await next_of(client))["capabilities"] == ["time"], "nothing to publish, set or call"
    channels = {each["topic"]: each for each in (await next_of(client))["channels"]}
    wanted = [{"id": place, "channelId": int(channels[topic]["id"])} for place, topic in enumerate(topics)]
    await client.write_message(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    try:
        yield client, channels
    finally:
        client.close()
        while await client.read_message() is not None:  # what is still on its way, up to the server's close
            pass


def test_a_client_gets_the_messages_of_a_running_graph_with_their_definitions_at_simulated_time() -> None:
    safety = SafetyState(tick=7, curvttc=[1.25], distance=[8.0], critical=[True])

    async def publish(publishers: dict[str, Any]) -> None:
        for tick in itertools.count():
            clock = Clock()
            clock.clock.sec, clock.clock.nanosec = 40 + tick // 20, tick % 20 * 50_000_000
            publishers["/clock"].publish(clock)
            publishers["/safety/state"].publish(safety)
            await asyncio.sleep(0.05)

    async def seen(address: str, publishers: dict[str, Any]) -> tuple[dict[str, Any], int, bytes]:
        async with subscribed(address, "/safety/state") as (client, channels):
            publishing = asyncio.create_task(publish(publishers))  # what comes before they are found is lost
            at = 0
            while at == 0:
                _, at, payload = await next_of(client)
            publishing.cancel()
            return channels, at, payload

    context = Context()
    with own_domain(), closing(FoxgloveView()) as view:
        showing = threading.Thread(target=view.show_graph, daemon=True)
        showing.start()
        rclpy.init(context=context)
        node = rclpy.create_node("graph", context=context)
        try:
            names = {"/clock": Clock, "/safety/state": SafetyState}
            publishers = {name: node.create_publisher(kind, name, TOPICS[name].qos) for name, kind in names.items()}
            channels, at, payload = asyncio.run(seen(view.address, publishers))
        finally:
            node.destroy_node()
            context.shutdown()
    showing.join(60.0)
    assert not showing.is_alive()
    assert set(channels) == set(SHOWN)
    for name, channel in channels.items():
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        assert channel["schemaName"] == TOPICS[name].type_name
    assert "float64[] curvttc" in channels["/safety/state"]["schema"]
    assert at >= 40_000_000_000
    assert deserialize_message(payload, SafetyState) == safety
