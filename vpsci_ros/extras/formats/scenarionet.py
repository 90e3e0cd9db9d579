"""Episodes as a ScenarioNet database, which MetaDrive replays: one record a file, a summary and a mapping.

The format is defined as Python pickles, so pickles are what is written here, of plain dicts, strings, numbers and numpy
arrays. Nothing in this package reads them, nor any other pickle: loading one runs whatever code its maker put into it.

A record has a frame a tenth of a second, as ScenarioNet and MetaDrive expect; the last frame is kept where it falls on
one. Positions are the centres of boxes on a flat road.
"""

import pickle
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from vpsci_ros.data.episode import Episode, Floats
from vpsci_ros.extras.formats.exporters import Options
from vpsci_ros.extras.formats.movers import Mover, lane_lines, movers, road_of, tenths
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.world import Scenario
from vpsci_ros.world.observation import STEP

EGO = "ego"
_DATASET = "vpsci_ros"
_PROTOCOL = 4


def write(episodes: Iterable[Episode], folder: Path, options: Options) -> int:
    """Write sd_vpsci_ros_NAME.pkl for each episode, dataset_summary.pkl and _mapping.pkl; return their number."""
    summary = {}
    for episode in episodes:
        found = record(episode)
        name = f"sd_{_DATASET}_{episode.label}.pkl"
        _dump(found, folder / name)
        summary[name] = found["metadata"]
    _dump(summary, folder / "dataset_summary.pkl")
    _dump(dict.fromkeys(summary, ""), folder / "dataset_mapping.pkl")
    return len(summary) + 2


def _dump(content: dict[str, Any], path: Path) -> None:
    with atomic_write(path) as part:
        part.write_bytes(pickle.dumps(content, _PROTOCOL))


def record(episode: Episode) -> dict[str, Any]:
    """Return an episode as the dictionary of a ScenarioNet record.

    :raises InvalidInput: see `tenths`, `movers` and `road_of`.
    """
    frames = tenths(episode)
    times = episode.time[frames].astype(np.float32)
    tracks = {}
    for number, each in enumerate(movers(episode)):
        name, kind = (f"pedestrian{number}", "PEDESTRIAN") if number else (EGO, "VEHICLE")
        tracks[name] = _track(name, kind, each, frames)
    road = road_of(episode)
    about = {
        "id": episode.label,
        "scenario_id": episode.label,
        "dataset": _DATASET,
        "source_file": episode.label,
        "coordinate": "right-handed",
        "metadrive_processed": False,
        "sdc_id": EGO,
        "ts": times,
        "sample_rate": STEP,
        "track_length": len(times),
        "map": road.location,
        "outcome": episode.outcome,
    }
    return {
        "id": episode.label,
        "version": "1.0",
        "length": len(times),
        "tracks": tracks,
        "dynamic_map_states": {},
        "map_features": _map(road),
        "metadata": about,
    }


def _track(name: str, kind: str, each: Mover, frames: slice) -> dict[str, Any]:
    x, y, heading, vx, vy = (column[frames] for column in (each.x, each.y, each.heading, each.vx, each.vy))
    count = len(x)
    state = {
        "position": np.stack([x, y, np.full(count, 0.5 * each.size[2])], axis=1).astype(np.float32),
        "heading": np.angle(np.exp(1j * heading)).astype(np.float32),
        "velocity": np.stack([vx, vy], axis=1).astype(np.float32),
        "valid": np.ones(count, np.bool_),
    }
    state |= {
        key: np.full(count, value, np.float32)
        for key, value in zip(("length", "width", "height"), each.size, strict=True)
    }
    about = {"track_length": count, "type": kind, "object_id": name, "dataset": _DATASET}
    return {"type": kind, "state": state, "metadata": about}


def _map(road: Scenario) -> dict[str, Any]:
    centre, left, right = lane_lines(road)
    features: dict[str, Any] = {
        "lane": {
            "type": "LANE_SURFACE_STREET",
            "polyline": _flat(centre),
            "polygon": np.concatenate([left, right[::-1]]).astype(np.float32),  # MetaDrive 0.4.3 adds the height itself
            "entry_lanes": [],
            "exit_lanes": [],
            "left_neighbor": [],
            "right_neighbor": [],
        },
        "left": {"type": "ROAD_EDGE_BOUNDARY", "polyline": _flat(left)},
        "right": {"type": "ROAD_EDGE_BOUNDARY", "polyline": _flat(right)},
    }
    if len(road.crosswalk):
        features["crosswalk"] = {"type": "CROSSWALK", "polygon": _flat(road.crosswalk)}
    return features


def _flat(points: Floats) -> Floats:
    return np.concatenate([points, np.zeros((len(points), 1))], axis=1).astype(np.float32)
