"""Simulated episodes kept as a file: their motion as arrays one behind the other, and what is listed of each."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.documents import parse_json, require_regular
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.world.scenario import every_scenario, own_documents

KEPT = "episodes.npz"  # of a run of an exam
_VEHICLE = ("x", "y", "heading", "speed", "curvature")
_PEOPLE = ("ped_x", "ped_y", "ped_vx", "ped_vy", "curvttc", "distance", "controlled")


def write_kept(path: Path, episodes: Sequence[Episode]) -> None:
    """Write simulated episodes, whole or not at all, with the scenarios of one's own in which they take place."""
    own = own_documents({each.key[0]: each.scenario for each in episodes if each.scenario is not None}.values())
    listed = [{"listed": each.listed, "period": each.period, "shape": each.ped_x.shape} for each in episodes]
    arrays = {name: np.concatenate([np.zeros(0), *(getattr(each, name).ravel() for each in episodes)])
              for name in (*_VEHICLE, *_PEOPLE)}  # fmt: skip
    with atomic_write(path) as part, open(part, "wb") as file:
        np.savez_compressed(file, text=np.array(json.dumps([own, listed])), **arrays)  # type: ignore[arg-type]


def read_kept(path: Path) -> list[Episode]:
    """Return the episodes of such a file.

    :raises InvalidInput: it cannot be read, or holds something else.
    """
    require_regular(path)
    try:
        with open(path, "rb") as source, np.load(source, allow_pickle=False) as file:
            arrays = {name: file[name] for name in (*_VEHICLE, *_PEOPLE)}
            own, listed = parse_json(str(file["text"]), str(path))
        return _episodes(path, arrays, own, listed)
    except (OSError, EOFError, ValueError, LookupError, TypeError, AttributeError, BadZipFile) as error:
        raise InvalidInput(f"{path}: not readable as the episodes of a run ({error}); drive it again") from None


def _episodes(path: Path, arrays: dict[str, Any], own: dict[str, Any], listed: list[Any]) -> list[Episode]:
    roads = {scenario.number: scenario for scenario in every_scenario(own, str(path))}
    frames = people = 0
    found = []
    for each in listed:
        count, length = each["shape"]
        motion: dict[str, Any] = {name: arrays[name][frames : frames + length] for name in _VEHICLE}
        for name in _PEOPLE:
            motion[name] = arrays[name][people : people + count * length].reshape(count, length)
        motion["controlled"] = motion["controlled"].astype(np.bool_)
        frames, people = frames + length, people + count * length
        own_name = Listed(*each["listed"])
        found.append(Episode(str(path), own_name, roads.get(own_name.scenario), each["period"], **motion))
    return found
