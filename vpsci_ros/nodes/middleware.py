"""What the middleware is told before a context is made, where the environment does not say otherwise."""

import os

from vpsci_ros.resources import params_dir


def set_defaults() -> None:
    """Have discovery stay on this host, and Fast DDS ask readers soon for what they have (`params/middleware.xml`).

    Without the file it asks every 3 s, and a node that ends waits so long for the recorder to have everything.
    """
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(params_dir() / "middleware.xml"))
