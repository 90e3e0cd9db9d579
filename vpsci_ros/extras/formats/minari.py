"""Episodes as Minari datasets, one for each agent: observations, actions, rewards every 0.1 s (section 4.7).

Minari (minari.farama.org) is the common format for behaviour cloning, inverse and offline reinforcement learning. Its
Parquet layout is written directly, so that this needs no library. Observations are (6) and (7), actions the
accelerations [m/s2] that bring about the next velocity, (forward, left) in the vehicle's heading frame; the reward is
(25) and (26) at the last step, since (14) is zero for what was really done. Collision and goal terminate an episode,
everything else truncates it. `infos` has CurvTTC [s] and whether the policies had control.
"""

import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vpsci_ros.data.episode import Episode
from vpsci_ros.data.interactions import seen_and_done
from vpsci_ros.extras.formats.exporters import Options
from vpsci_ros.extras.formats.movers import movers, tenths
from vpsci_ros.runs.files import write_json
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS, OBSERVATION_SIZE

NAMESPACE, VERSION = "vpsci", "0.5.4"  # of Minari, whose layout this is
REWARDS = {"collision": -200.0, "goal": 100.0}  # (25), (26)


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Write `folder`/vpsci/vehicle-v0 and pedestrian-v0, and return the number of Parquet files, one an episode.

    The vehicle's episodes have the most critical pedestrian; each pedestrian has an episode of its own.
    """
    count, steps = Counter[str](), Counter[str]()
    for episode in episodes:
        for agent, pairs in zip(AGENTS, ([episode.pair()], episode.pairs()), strict=True):
            for pair in pairs:
                table = demonstration(pair, agent)
                place = _data(folder, agent) / str(count[agent])
                place.mkdir(parents=True)
                pq.write_table(table, place / "part-0.parquet", compression="zstd")
                about = {"id": count[agent], "total_steps": table.num_rows - 1, "episode": pair.label}
                write_json(place / "metadata.json", about | {"outcome": pair.outcome})
                count[agent] += 1
                steps[agent] += table.num_rows - 1
    for agent in count:
        size = sum(path.stat().st_size for path in _data(folder, agent).rglob("*.parquet")) / 1e6
        write_json(
            _data(folder, agent) / "metadata.json",
            {
                "dataset_id": f"{NAMESPACE}/{agent}-v0",
                "description": f"The {agent} in safety-critical encounters of one vehicle and one pedestrian.",
                "data_format": "parquet",
                "jpeg_encoding": False,
                "minari_version": VERSION,
                "total_episodes": count[agent],
                "total_steps": steps[agent],
                "dataset_size": round(size, 6),
                "observation_space": _box(OBSERVATION_SIZE),
                "action_space": _box(ACTION_SIZE),
            },
        )
    return sum(count.values())


def _data(folder: Path, agent: str) -> Path:
    return folder / NAMESPACE / f"{agent}-v0" / "data"


def _box(size: int) -> str:
    """Return an unbounded space of float32[size] as Minari writes it."""
    infinity = [float("inf")] * size
    low = [-each for each in infinity]
    return json.dumps({"type": "Box", "dtype": "float32", "shape": [size], "low": low, "high": infinity})


def demonstration(pair: Episode, agent: str) -> pa.Table:
    """Return one agent's T steps as a table of T + 1 rows; the last row's actions and rewards have no meaning.

    :raises InvalidInput: see `movers` and `tenths`.
    """
    vehicle, walker = movers(pair)
    frames = tenths(pair)
    motion = np.column_stack([vehicle.x, vehicle.y, vehicle.heading, vehicle.vx, vehicle.vy])
    motion = np.column_stack([motion, walker.x, walker.y, walker.vx, walker.vy])[frames]
    observation, action, _ = seen_and_done(motion[None], np.array([len(motion)]))
    reward, ends = np.zeros(len(motion)), np.zeros(len(motion), bool)
    reward[-2:-1] = REWARDS.get(pair.outcome, 0.0)
    ends[-2:-1] = True
    finished = pair.outcome in REWARDS
    known = {"curvttc": pair.known_curvttc[0][frames].astype(np.float32), "controlled": pair.controlled[0][frames]}
    columns: dict[str, Any] = {
        "observations": _rows(observation[agent][0]),
        "actions": _rows(action[agent][0]),
        "rewards": reward,
        "terminations": ends & finished,
        "truncations": ends & (not finished),
        "infos": pa.StructArray.from_arrays([pa.array(each) for each in known.values()], names=list(known)),
    }
    return pa.table(columns)


def _rows(values: np.ndarray[Any, np.dtype[np.float32]]) -> pa.Array:
    return pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), values.shape[1])
