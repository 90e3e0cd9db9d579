"""What the middleware reads from the environment: the domain, discovery, and the settings of Fast DDS."""

import contextlib
import os
from collections.abc import Iterator

from domain_coordinator import domain_id

from vpsci_ros.resources import params_dir


def set_defaults() -> None:
    """Have discovery stay on this host, and Fast DDS send heartbeats often (`params/middleware.xml`), unless set.

    Without that file it sends them every 3 s, and a node that ends waits so long for the recorder's acknowledgement.
    """
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(params_dir() / "middleware.xml"))


@contextlib.contextmanager
def own_domain() -> Iterator[None]:
    """Run in a ROS domain that no other graph on this machine uses, unless the environment names one."""
    if "ROS_DOMAIN_ID" in os.environ:
        yield
        return
    reserved = contextlib.ExitStack()  # closed without the error: domain_id takes an OSError for one of its own
    os.environ["ROS_DOMAIN_ID"] = str(reserved.enter_context(domain_id()))
    try:
        yield
    finally:
        del os.environ["ROS_DOMAIN_ID"]
        reserved.close()
