"""Bags: messages per second recorded without loss, replayed, written and read; episodes exported and verified.

    python benchmarks/bench_bags.py [--ticks 3000] [--wide-ticks 300]

A bag is made in process by the rule-based pair, once with one episode and once with 1,024 in each message. The
replayer publishes it as fast as it can, to a bare reader and to the recorder, each in a process of its own; what the
recorder wrote is compared with the bag, message by message. The control is the writer without ROS.
"""

import argparse
import io
import itertools
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import rclpy
from domain_coordinator import domain_id
from mcap.reader import make_reader
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rich.console import Console

from vpsci_ros.bags.export import export_bag
from vpsci_ros.bags.reader import Bag, bag_files
from vpsci_ros.bags.run_record import node_record
from vpsci_ros.bags.simulated import write_ticks
from vpsci_ros.bags.verify import verify_bag
from vpsci_ros.bags.writer import BagTopic, BagWriter
from vpsci_ros.nodes.topics import RECORDING, TOPICS
from vpsci_ros.parameters import table
from vpsci_ros.runs.provenance import cpu_name, software_versions
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop

DRIVERS = {"vehicle_driver": "autopilot", "pedestrian_driver": "autopilot"}
LIMIT = 60.0  # [s] for one replay


def make(folder: Path, ticks: int, batch: int) -> Path:
    """Write a bag of so many ticks."""
    config = WorldConfig(**DRIVERS)
    queue = [(1 + n % 8, n) for n in range(batch + batch * ticks // 60)]
    world = World(config, load_scenarios(range(1, 9)), queue, batch, 1)
    steps = itertools.islice(Loop(world), ticks)
    parameters = {row.name: getattr(config, row.name) for row in table(WorldConfig)}
    run = {"seed": 1, "scenarios": list(range(1, 9)), "batch": batch, "queue": queue}
    write_ticks(steps, config, folder, {}, [node_record("world_simulator", parameters | run)])
    return folder


def node(name: str, *arguments: str) -> subprocess.Popen[bytes]:
    """Start a node."""
    given = [text for argument in arguments for text in ("-p", argument)]
    command = [sys.executable, "-m", "vpsci_ros.nodes", name, "--ros-args", *given]
    return subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)


def replay(bag: Path) -> None:
    """Run the replayer to its end, as fast as it can."""
    if node("replayer", f"bag:={bag}", "rate:=0.0", "peers:=[recorder]").wait(LIMIT):
        raise SystemExit("the replayer failed")


def read(expected: int) -> None:
    """Be a bare reader: take `expected` messages in and print the seconds from the first to the last."""
    context = Context()
    rclpy.init(context=context)
    listener = rclpy.create_node("reader", context=context)
    times: list[float] = []
    for name, row in TOPICS.items():
        if name != "/diagnostics":
            listener.create_subscription(
                row.type, name[1:], lambda _: times.append(time.perf_counter()), RECORDING, raw=True
            )
    executor = EventsExecutor(context=context)
    executor.add_node(listener)
    begun = time.perf_counter()
    while len(times) < expected and time.perf_counter() - begun < LIMIT:
        executor.spin_once(timeout_sec=0.2)
    print(len(times), times[-1] - times[0] if times else 0.0, flush=True)
    context.try_shutdown()
    sys.exit()


def replayed(bag: Path, messages: int, clocks: int) -> float:
    """Return messages per second from the replayer to a bare reader."""
    reader = subprocess.Popen([sys.executable, __file__, "--read", str(messages + clocks)], stdout=subprocess.PIPE)
    replay(bag)
    out, _ = reader.communicate(timeout=LIMIT)
    got, seconds = out.split()
    if int(got) != messages + clocks:
        raise SystemExit(f"the reader got {got.decode()} of {messages + clocks} messages")
    return int(got) / float(seconds)


def recorded(bag: Path, folder: Path) -> tuple[int, float]:
    """Return how many messages the recorder lost, and how many it took in per second."""
    recorder = node("recorder", f"bag:={folder}")
    replay(bag)
    recorder.send_signal(signal.SIGINT)
    recorder.wait(60.0)
    topics = [name for name in Bag(bag).topics() if name in TOPICS]
    there, here = (
        Counter((raw.topic, _padded(raw.data)) for raw in Bag(each).messages(topics)) for each in (bag, folder)
    )
    times = []
    for path in bag_files(folder):
        with path.open("rb") as file:
            times += [m.publish_time for _, c, m in make_reader(file).iter_messages() if c.topic != "/diagnostics"]
    return (there - here).total(), (len(times) - 1) * 1e9 / (max(times) - min(times))


def _padded(data: bytes) -> bytes:
    """Return a message as the middleware delivers it: filled up to a multiple of 4 bytes."""
    return data + bytes(-len(data) % 4)


def written(bag: Path, folder: Path) -> float:
    """Return messages per second that the writer takes without ROS."""
    messages = list(Bag(bag).messages())
    topics = {raw.topic: BagTopic(raw.topic, raw.type, raw.definition, "") for raw in messages}
    writer = BagWriter(folder, list(topics.values()))
    begun = time.perf_counter()
    for raw in messages:
        writer.write(raw.topic, raw.data, raw.time, raw.time)
    writer.close({})
    return len(messages) / (time.perf_counter() - begun)


def _rows(ticks: int, batch: int, seconds: float) -> str:
    return f"{ticks * batch / seconds:12,.0f} rows/s     {0.05 * ticks / seconds:10,.0f} x real time"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=3000, help="of the bag with one episode in a message")
    parser.add_argument("--wide-ticks", type=int, default=300, help="of the bag with 1,024")
    parser.add_argument("--read", type=int, default=0, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.read:
        read(arguments.read)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    print(f"{cpu_name() or platform.machine()}, {os.cpu_count()} cores; {software_versions()}")
    with domain_id() as number, tempfile.TemporaryDirectory() as name:
        os.environ["ROS_DOMAIN_ID"] = str(number)
        for batch, ticks in ((1, arguments.ticks), (1024, arguments.wide_ticks)):
            folder = Path(name) / str(batch)
            folder.mkdir()
            bag = make(folder / "bag", ticks, batch)
            rows = Bag(bag).topics().values()
            messages, clocks = sum(row.messages for row in rows), max(row.messages for row in rows)
            size = sum(len(raw.data) for raw in Bag(bag).messages())
            print(
                f"\n{batch:,} episodes a message: {messages:,} messages of {size / messages:,.0f} bytes, {ticks} ticks"
            )
            each = (messages + clocks) / (0.05 * ticks)  # messages per second of simulated time
            rate = written(bag, folder / "written")
            print(f"  writer without ROS      {rate:12,.0f} messages/s {rate * size / messages / 1e6:10,.1f} MB/s")
            rate = replayed(bag, messages, clocks)
            print(f"  replayer to a reader    {rate:12,.0f} messages/s {rate / each:10,.0f} x real time")
            lost, rate = recorded(bag, folder / "recorded")
            print(f"  replayer to recorder    {rate:12,.0f} messages/s {rate / each:10,.0f} x real time, {lost} lost")
            begun = time.perf_counter()
            export_bag(bag, folder / "table", formats=("parquet",), console=Console(file=io.StringIO()))
            print(f"  export to Parquet       {_rows(ticks, batch, time.perf_counter() - begun)}, picture included")
            begun = time.perf_counter()
            verified = verify_bag(bag)
            print(f"  verify                  {_rows(ticks, batch, time.perf_counter() - begun)}")
            if verified.difference:
                raise SystemExit(verified.difference)


if __name__ == "__main__":
    main()
