"""Information on a bag: topics, rates, episodes, outcomes, origin, and what it lacks for some commands."""

import dataclasses
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape as without_markup
from rich.table import Table

from vpsci_ros.bags.episodes import EPISODE_RECORD, BagEpisode, bag_episodes
from vpsci_ros.bags.reader import Bag
from vpsci_ros.bags.run_record import BagRun, bag_run
from vpsci_ros.bags.topic_info import TopicInfo, extent
from vpsci_ros.documents import counted, printable
from vpsci_ros.errors import InvalidInput
from vpsci_ros.wire.layout import SAFETY, WORLD

SHOWN = 12  # episodes in the printed list


def bag_info(path: str | Path) -> dict[str, Any]:
    """Return information on a bag, or on its readable part, as JSON values; times in seconds.

    :raises InvalidInput: no bag, or nothing of it is readable.
    """
    refusals: list[InvalidInput] = []
    try:
        bag = Bag(path)
        topics, run = bag.topics(), bag_run(bag)
    except InvalidInput as refused:
        bag = Bag(path, recover=True)
        topics = bag.topics()
        refusals.append(refused)
        try:
            run = bag_run(bag)
        except InvalidInput as damaged:
            run, refusals = BagRun(), [damaged]
    damage = bag.damage or [str(refusal).removeprefix(f"{path}: ") for refusal in refusals]
    if not any(topic.messages for topic in topics.values()):
        raise InvalidInput(f"{path}: the bag holds no message" + (f" that is whole ({damage[0]})" if damage else ""))
    simulated = bool(run.totals or run.software)
    first, last = extent(topics.values())
    records = [name for name, _ in bag.records()]
    told = EPISODE_RECORD in records or (WORLD in topics and topics[WORLD].messages)
    episodes = bag_episodes(bag) if told else []
    seen, written = run.count("seen"), run.count("written")
    return {
        "bag": str(path),
        "files": [file.path.name for file in bag.files],
        "bytes": sum(file.path.stat().st_size for file in bag.files),
        "damage": damage,
        "time": "simulated" if simulated else "of receipt",
        "duration": (last - first) * 1e-9,
        "messages": sum(topic.messages for topic in topics.values()),
        "messages_seen": sum(seen.values()) if seen else None,
        "messages_written": sum(written.values()) if written else None,
        "topics": [
            {
                "name": topic.name,
                "type": topic.type,
                "messages": topic.messages,
                "rate": topic.rate,
                "seen": seen.get(topic.name),
                "written": written.get(topic.name),
            }
            for topic in topics.values()
        ],
        "episodes": [_episode(episode) for episode in episodes],
        "outcomes": dict(Counter(episode.listed.outcome for episode in episodes)),
        "episodes_unfinished": int(run.totals.get("episodes_unfinished", 0)),
        "run": {name: value for name, value in dataclasses.asdict(run).items() if name != "totals"},
        "missing": what_is_missing(topics, run, records),
    }


def what_is_missing(topics: dict[str, TopicInfo], run: BagRun, records: list[str]) -> list[str]:
    """Return sentences about what a bag lacks, and which commands need it."""
    has = {name for name, topic in topics.items() if topic.messages}
    missing = []
    if WORLD not in has:
        missing.append(f"{WORLD}: no export, no verify")
    elif SAFETY not in has:
        missing.append(f"{SAFETY}: CurvTTC is unknown")
    if WORLD in has and EPISODE_RECORD not in records:
        missing.append("records of episodes: they are found by reading all of the world's states")
    if WORLD in has and "world_simulator" not in run.parameters:
        missing.append("the nodes' parameters: no verify")
    return missing


def escape(text: str) -> str:
    """Return a printable text from a bag, with markup and control sequences escaped."""
    return without_markup(printable(text))


def print_info(info: dict[str, Any], console: Console) -> None:
    """Print what `bag_info` returned."""
    size = f"{info['bytes'] / 1e6:.1f} MB" if info["bytes"] > 1e5 else f"{info['bytes'] / 1e3:.1f} kB"
    counts = "seen and written not counted"
    if info["messages_seen"] is not None:
        counts = f"{info['messages_seen']:,} seen, {info['messages_written']:,} written"
    files = f"{len(info['files'])} files" if len(info["files"]) > 1 else info["files"][0]
    console.print(escape(f"{info['bag']}: {files}, {size}, {info['duration']:.2f} s ({info['time']} time)"))
    console.print(f"{counted(info['messages'], 'message')} ({counts})")
    for text in info["damage"]:
        console.print(escape(f"damaged: {text}; this is what is readable; `vpsci bag repair` completes an MCAP bag"))
    table = Table("topic", "type", box=None, header_style="bold")
    for name in ("messages", "Hz"):
        table.add_column(name, justify="right")
    for topic in info["topics"]:
        lost = (topic["seen"] or 0) - (topic["written"] or 0)
        note = f" ({lost} not written)" if lost else ""
        rate = f"{topic['rate']:.2f}" if topic["rate"] else ""
        table.add_row(escape(topic["name"]), escape(topic["type"]), f"{topic['messages']:,}{note}", rate)
    console.print(table)
    _print_episodes(info, console)
    _print_run(info["run"], console)
    for text in info["missing"]:
        console.print(escape(f"missing: {text}"))


def _print_episodes(info: dict[str, Any], console: Console) -> None:
    episodes = info["episodes"]
    outcomes = ", ".join(f"{count} {name}" for name, count in sorted(info["outcomes"].items()))
    unfinished = f", {info['episodes_unfinished']} unfinished" if info["episodes_unfinished"] else ""
    console.print(f"{counted(len(episodes), 'episode')}: {outcomes or 'none that ended in it'}{unfinished}")
    least = [e["least_curvttc"] for e in episodes if e["least_curvttc"] is not None]
    if least:
        quartiles = ", ".join(f"{value:.2f}" for value in np.quantile(least, [0.25, 0.5, 0.75]))
        console.print(f"least CurvTTC [s] of {len(least):,} with one: quartiles {quartiles}".replace("[s]", r"\[s]"))
    table = Table("episode", "outcome", box=None, header_style="bold")
    for name in (r"begins \[s]", r"lasts \[s]", r"least CurvTTC \[s]"):
        table.add_column(name, justify="right")
    for e in episodes[:SHOWN]:
        ttc = "" if e["least_curvttc"] is None else f"{e['least_curvttc']:.2f}"
        table.add_row(e["name"], e["outcome"], f"{e['start']:.2f}", f"{e['end'] - e['start']:.2f}", ttc)
    if episodes:
        console.print(table)
    if len(episodes) > SHOWN:
        console.print(f"... and {len(episodes) - SHOWN:,} more; --json lists all")


def _print_run(run: dict[str, Any], console: Console) -> None:
    world = run["parameters"].get("world_simulator", {})
    if world:
        drivers = f"vehicle {world.get('vehicle_driver')}, pedestrian {world.get('pedestrian_driver')}"
        console.print(escape(f"seed {world.get('seed')}, batch {world.get('batch')}; {drivers}"))
    for node, digest in sorted(run["weights"].items()):
        name = run["parameters"].get(node, {}).get("weights", "")
        console.print(escape(f"{node}: weights {name}, SHA-256 {digest or 'unknown'}"), soft_wrap=True)
    for refresh in run["refreshes"]:
        text = f"learner: weights of version {refresh['version']}, SHA-256 {refresh['sha256']}"
        console.print(text, soft_wrap=True)
    if run["software"]:
        names = ("vpsci_ros", "python", "numpy", "ros-jazzy-rclpy")
        versions = ", ".join(f"{name} {run['software'][name]}" for name in names if name in run["software"])
        made = f"made with {versions} on {run['software'].get('cpu', 'an unknown CPU')}"
        console.print(escape(made), soft_wrap=True)


def _episode(episode: BagEpisode) -> dict[str, Any]:
    values = episode.values() | {"name": episode.listed.name}
    values["start"], values["end"] = values.pop("start_time") * 1e-9, values.pop("end_time") * 1e-9
    if not math.isfinite(episode.listed.least_curvttc):
        values["least_curvttc"] = None
    return values
