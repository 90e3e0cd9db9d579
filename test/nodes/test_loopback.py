"""With params/loopback.xml nobody on the network reaches a node, and nodes find each other all the same."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from vpsci_ros.resources import params_dir

TALK = """
import rclpy, time
from std_msgs.msg import String
rclpy.init()
node, heard = rclpy.create_node("one"), []
other = rclpy.create_node("other")
node.create_subscription(String, "t", lambda message: heard.append(message.data), 10)
talker = other.create_publisher(String, "t", 10)
while not heard:
    talker.publish(String(data="hello"))
    rclpy.spin_once(node, timeout_sec=0.1)
print("heard", flush=True)
input()
"""


def bound(pid: int, domain: int) -> set[str]:
    """Return the addresses, as the kernel writes them, to which a process has bound the UDP ports of a ROS domain.

    Its other sockets send only (OMG DDSI-RTPS 2.5, 9.6.2: ports are 7400 + 250 domain, and the 249 behind it).
    """
    own = set()
    for handle in Path(f"/proc/{pid}/fd").iterdir():
        target = str(handle.readlink())
        if target.startswith("socket:["):
            own.add(target.removeprefix("socket:[").removesuffix("]"))
    rows = [line.split() for line in Path(f"/proc/{pid}/net/udp").read_text().splitlines()[1:]]
    sockets = [row[1].partition(":") for row in rows if row[9] in own]
    return {address for address, _, port in sockets if 0 <= int(port, 16) - 7400 - 250 * domain < 250}


@pytest.mark.parametrize(("profile", "everywhere"), [("loopback.xml", False), (None, True)])
def test_ports_are_bound_to_this_host_alone(profile: str | None, everywhere: bool, domain: int) -> None:
    own = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(domain)}
    own |= {"FASTRTPS_DEFAULT_PROFILES_FILE": str(params_dir() / profile)} if profile else {}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", TALK], env=os.environ | own, text=True, **pipes) as node:
        try:
            assert "heard\n" in node.stdout  # after what Fast DDS may have said of ports that others just opened
            addresses = bound(node.pid, domain)
        finally:
            node.kill()
    assert addresses == ({"00000000"} if everywhere else {"0100007F"})  # every interface, or 127.0.0.1
