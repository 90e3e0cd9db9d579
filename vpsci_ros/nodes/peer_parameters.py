"""The parameters of the graph's nodes, as the nodes themselves reply."""

import itertools
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python

from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes.base import GraphNode
from vpsci_ros.nodes.config import LEARNER, SECTIONS, section_classes
from vpsci_ros.parameters import pick, table

PERIOD = 0.1  # [s] between looks at which services are there
PATIENCE = 1.0  # [s] for a reply before the next request: one that is sent before both directions are matched is lost


class PeerParameters:
    """Sends each node a request once it is there, until it has replied.

    A node replies with nothing where it lacks a parameter, so the requests to a learner alternate between the stages.

    :param names: nodes in the namespace of `node`; those without a section of `SECTIONS` get no request.
    :param received: called with a node's name and its parameters, once each; may refuse them by `InvalidInput`.
    """

    def __init__(self, node: GraphNode, names: list[str], received: Callable[[str, dict[str, Any]], None]) -> None:
        self._received, self._intake = received, node.intake
        known = [name for name in names if name in SECTIONS or name == "learner"]
        self._clients = {name: node.create_client(GetParameters, f"{name}/get_parameters") for name in known}
        self._requested_at = dict.fromkeys(known, 0.0)
        self._stages = itertools.cycle(LEARNER)
        node.wall_timer(PERIOD, self._request)

    @property
    def missing(self) -> list[str]:
        """Nodes that have not replied yet."""
        return list(self._requested_at)

    def _request(self) -> None:
        now = time.monotonic()
        for name, requested_at in list(self._requested_at.items()):
            if now - requested_at > PATIENCE and self._clients[name].service_is_ready():
                self._requested_at[name] = now
                stage = {"stage": next(self._stages)} if name == "learner" else {}
                names = [row.name for kind in section_classes(name, stage) for row in table(kind)]
                future = self._clients[name].call_async(GetParameters.Request(names=names))
                future.add_done_callback(partial(self._on_reply, name, names))

    def _on_reply(self, name: str, names: list[str], future: Any) -> None:
        if name not in self._requested_at:
            return
        answer = future.result().values
        if not answer:
            self._requested_at[name] = 0.0  # a learner of the other stage
        else:
            self._intake.read(f"/{name}/get_parameters", self._take_reply, name, names, answer)

    def _take_reply(self, name: str, names: list[str], answer: Any) -> None:
        """Take in the values of a reply.

        :raises InvalidInput: they are not values of these parameters.
        """
        if len(answer) != len(names):
            raise InvalidInput(f"/{name}/get_parameters: expected {len(names)} values, got {len(answer)}")
        values = [parameter_value_to_python(value) for value in answer]
        plain = [list(value) if hasattr(value, "tolist") or isinstance(value, tuple) else value for value in values]
        found = {key: value for key, value in zip(names, plain, strict=True) if value is not None}
        for kind in section_classes(name, found):
            pick(kind, {row.name: found[row.name] for row in table(kind) if row.name in found}, name)
        self._received(name, found)
        del self._requested_at[name]
