"""The executable `carla_world` of `ros2 run vpsci_ros`; like `vpsci_ros.nodes.entry`, it imports quickly."""

from functools import partial

from vpsci_ros.nodes.entry import start

carla_world = partial(start, "vpsci_ros.extras.carla.node:CarlaWorld")
