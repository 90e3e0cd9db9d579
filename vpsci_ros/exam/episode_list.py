"""Lists of episodes that somebody wants driven again, as `vpsci ads-search` leaves and `--episodes` takes them.

A number alone says little: the same one begins otherwise under another seed or other parameters of the world. The list
has these with it, and is refused where they are others.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from vpsci_ros.data.episode import Key
from vpsci_ros.documents import read_json, require_form
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.config import RunConfig
from vpsci_ros.runs.files import write_json
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.sections import Sections
from vpsci_ros.world import Scenario, WorldConfig, load_scenarios

_FORM = "vpsci_ros episodes, 1"
_EXPECTED = "expected a list of episodes as `vpsci ads-search` writes it"


def write_episode_list(
    path: Path, rows: Sequence[Mapping[str, Any]], run: RunConfig, world: WorldConfig, scenarios: Iterable[Scenario]
) -> None:
    """Write a list, whole or not at all.

    :param rows: with the keys scenario and episode; what else they hold is written for people.
    :param scenarios: all that the run has.
    """
    named = {row["scenario"] for row in rows}
    hashes = {str(each.number): each.sha256 for each in scenarios if each.number in named}
    write_json(
        path, {"form": _FORM, "seed": run.seed, "world": _world(world), "scenarios": hashes, "episodes": list(rows)}
    )


def with_episode_list(sections: Sections, path: Path) -> Sections:
    """Return the parameters with the episodes of a list instead of their own, and its seed.

    :raises InvalidInput: not such a list, or the parameters begin its episodes otherwise.
    """
    stored = read_json(path)
    require_form(stored, dict, f"{path}: {_EXPECTED}")
    if stored.get("form") != _FORM or not isinstance(stored.get("episodes"), list):
        raise InvalidInput(f"{path}: {_EXPECTED}, with form {_FORM!r} and episodes")
    keys = sorted({_key(entry, path) for entry in stored["episodes"]}, key=lambda key: (key[1], key[0]))
    if not keys:
        raise InvalidInput(f"{path}: it holds no episode")
    numbers = sorted({scenario for scenario, _ in keys})
    chosen = sections.changed("world_simulator", {"seed": stored.get("seed"), "scenarios": numbers, "only": flat(keys)})
    run = chosen.get(RunConfig, "world_simulator")
    hashes = {str(each.number): each.sha256 for each in load_scenarios(run.scenarios, run.scenario_files)}
    mine = {"world": _world(chosen.get(WorldConfig, "world_simulator")), "scenarios": hashes}
    require_same(path, stored, mine, "is of episodes")
    return chosen


def flat(keys: Iterable[Key]) -> list[int]:
    """Return scenario and number of each episode in turn, as the parameter `only` has them."""
    return [number for key in keys for number in key]


def _key(entry: Any, path: Path) -> Key:
    try:
        scenario, episode = entry["scenario"], entry["episode"]
    except (LookupError, TypeError):
        raise InvalidInput(f"{path}: an entry without scenario and episode; {_EXPECTED}") from None
    if type(scenario) is not int or type(episode) is not int:
        raise InvalidInput(f"{path}: scenario and episode must be whole numbers; {_EXPECTED}")
    return scenario, episode


def _world(world: WorldConfig) -> dict[str, Any]:
    """Return what begins an episode and moves it on; who drives is the exam's own."""
    return {name: value for name, value in dataclasses.asdict(world).items() if not name.endswith("_driver")}
