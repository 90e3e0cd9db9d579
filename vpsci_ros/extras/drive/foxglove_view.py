"""A running graph in Foxglove: its serialized messages, sent by the WebSocket server of Foxglove's SDK.

Bound to the loopback. It offers nothing by which a client could publish, set or call. Foxglove shows simulated time.
"""

from functools import partial

import foxglove
from foxglove.websocket import Capability, ChannelView, Client, ServerListener

from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.live import SHOWN, subscribe_to_graph
from vpsci_ros.nodes.topics import LATCHED, TOPICS
from vpsci_ros.wire.decoder import describe
from vpsci_ros.wire.header import stamp_of

LOOPBACK = "127.0.0.1"
WAITING = 100  # messages of a topic between two looks at it: five seconds of a graph in real time


class FoxgloveView(ServerListener):
    """Serves the topics of a graph to all connected Foxglove clients, until `close`.

    :param port: 0: a free one.
    :ivar address: to which Foxglove connects ("Open connection", "Foxglove WebSocket").
    :raises InvalidInput: the port is not free.
    """

    def __init__(self, port: int = 0) -> None:
        self.finished = False
        self._now = 0  # [ns] simulated
        self._latest: dict[str, bytes] = {}  # of topics that say once what holds from then on
        self._context = foxglove.Context()  # whose end would close the channels
        self._channels = {name: _channel(name, self._context) for name in SHOWN}
        serve = partial(foxglove.start_server, name="vpsci_ros", host=LOOPBACK, capabilities=[Capability.Time])
        try:
            self._server = serve(port=port, server_listener=self, context=self._context)
        except RuntimeError as error:
            raise InvalidInput(f"port {port} of this machine: {error}; choose another, or 0") from None
        self.address = f"ws://{LOOPBACK}:{self._server.port}"

    def show_graph(self) -> None:
        """Forward the messages of the graph in this ROS domain, until `close`."""
        subscribe_to_graph(SHOWN, self.take, lambda: self.finished, depth=WAITING)

    def take(self, topic: str, message: bytes) -> None:
        """Forward a serialized message with its simulated time.

        :raises InvalidInput: it is a /clock that has no time.
        """
        if topic == "/clock":
            self._now = stamp_of(topic, message)
            self._server.broadcast_time(self._now)
        if TOPICS[topic].qos is LATCHED:
            self._latest[topic] = message
        self._channels[topic].log(message, log_time=self._now)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Send latched messages to late subscribers; Foxglove calls this."""
        if channel.topic in self._latest:
            self._channels[channel.topic].log(self._latest[channel.topic], log_time=self._now)

    def close(self) -> None:
        """Stop the server."""
        self.finished = True
        self._server.stop()


def _channel(name: str, context: foxglove.Context) -> foxglove.Channel:
    kind = TOPICS[name].type_name
    schema = foxglove.Schema(name=kind, encoding="ros2msg", data=describe(kind)[0].encode())
    return foxglove.Channel(name, message_encoding="cdr", schema=schema, context=context)
