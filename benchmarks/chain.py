"""The control of every graph: three processes that pass one message on, three hops a round, and do nothing else.

    python benchmarks/chain.py [--rounds 3000] [--bytes 260]

The middleware, executor and quality of service are the graph's; a message is bytes that nobody reads. It prints
rounds a second.
"""

import argparse
import os
import subprocess
import sys
import time

import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from vpsci_ros.nodes.domain import set_defaults
from vpsci_ros.nodes.topics import LOCK_STEP

HOPS = 3
WARM_UP = 200  # rounds


class Hop:
    """One process of the chain: what it receives it publishes."""

    def __init__(self, number: int) -> None:
        self.received = 0
        self._context = Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = node = rclpy.create_node(f"hop_{number}", context=self._context)
        self.publisher = node.create_publisher(String, f"chain_{number}", LOCK_STEP)
        before = f"chain_{(number - 1) % HOPS}"
        subscription = node.create_subscription(String, before, self._pass_on, LOCK_STEP, raw=True)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(node)
        while not (self.publisher.get_subscription_count() and subscription.get_publisher_count()):
            self.spin()

    def spin(self) -> None:
        """Take what comes."""
        self._executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _pass_on(self, message: bytes) -> None:
        self.received += 1
        self.publisher.publish(message)


def rounds_per_second(rounds: int, size: int) -> float:
    """Return how often a message of `size` bytes goes round a second."""
    command = [sys.executable, __file__, "--hop"]
    others = [subprocess.Popen([*command, str(k)], stdout=subprocess.PIPE) for k in range(1, HOPS)]
    first = None
    try:
        first = Hop(0)
        for other in others:
            assert other.stdout is not None
            other.stdout.readline()  # it has found its neighbours
        first.publisher.publish(b"\0\1\0\0" + size.to_bytes(4, "little") + bytes(size))
        while first.received < WARM_UP:
            first.spin()
        done, begun = first.received, time.perf_counter()
        while first.received < done + rounds:
            first.spin()
        return (first.received - done) / (time.perf_counter() - begun)
    finally:
        for other in others:
            other.kill()
            other.wait()
        if first is not None:
            first.close()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3000)
    parser.add_argument("--bytes", type=int, default=260)
    parser.add_argument("--hop", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    set_defaults()
    if options.hop:
        hop = Hop(options.hop)
        print("ready", flush=True)
        while True:
            hop.spin()
    with domain_id() as number:
        os.environ["ROS_DOMAIN_ID"] = str(number)
        print(f"{rounds_per_second(options.rounds, options.bytes):.0f} rounds/s")


if __name__ == "__main__":
    main()
