"""Safety-critical vehicle-pedestrian interactions: learned, simulated, recorded and replayed as ROS 2 nodes."""

from vpsci_ros.runs.kernel_cache import choose_cache_folder

__version__ = "0.1.0"

choose_cache_folder()
