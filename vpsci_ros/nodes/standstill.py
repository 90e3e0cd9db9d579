"""A world that is paused while a policy of its graph is started again."""

import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool

from vpsci_ros.nodes.domain import set_defaults


class Standstill:
    """A client of the service `world/pause`; use it in a `with` block.

    :param namespace: of the graph.
    """

    def __init__(self, namespace: str) -> None:
        self._namespace = namespace
        self._awaited: dict[str, set[bytes]] = {}  # policy -> publishers of its topic before it was started again

    def __enter__(self) -> "Standstill":
        set_defaults()
        self._context = Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("graph_watch", context=self._context, namespace=self._namespace or None)
        self._pause = self._node.create_client(SetBool, "world/pause")
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    @property
    def lasts(self) -> bool:
        """Whether the world is paused for a policy that is started again."""
        return bool(self._awaited)

    def begin(self, policy: str) -> None:
        """Pause the world until another process of this policy publishes actions."""
        self._awaited[policy] = self._publishers(policy)
        self._pause.call_async(SetBool.Request(data=True))

    def spin(self) -> None:
        """Resume the world once every such policy publishes again."""
        self._executor.spin_once(timeout_sec=0.0)
        for policy in [name for name, before in self._awaited.items() if self._publishers(name) - before]:
            del self._awaited[policy]
            if not self._awaited:
                self._pause.call_async(SetBool.Request(data=False))

    def _publishers(self, policy: str) -> set[bytes]:
        topic = self._node.resolve_topic_name(f"{policy.removesuffix('_policy')}/action")
        return {bytes(writer.endpoint_gid) for writer in self._node.get_publishers_info_by_topic(topic)}
