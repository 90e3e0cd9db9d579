"""A ROS domain of one's own, so that two graphs on one machine do not disturb each other."""

import contextlib
import os
from collections.abc import Iterator

from domain_coordinator import domain_id


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
