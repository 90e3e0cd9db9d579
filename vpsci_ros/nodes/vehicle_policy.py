"""The vehicle's learned policy as a node."""

import sys
from typing import Any

from rclpy.context import Context

from vpsci_ros.nodes.agent_policy import AgentPolicy
from vpsci_ros.nodes.base import run


class VehiclePolicy(AgentPolicy):
    """`/world/state`, `/safety/state` and `/policy/weights` in, `/vehicle/action` out."""

    def __init__(self, *, context: Context | None = None, parameter_overrides: list[Any] | None = None) -> None:
        super().__init__("vehicle", context=context, parameter_overrides=parameter_overrides)


def main(args: list[str] | None = None) -> int:
    """Run the node until it is stopped."""
    return run(VehiclePolicy, args)


if __name__ == "__main__":
    sys.exit(main())
