"""The door of the exporters: a source and names of formats in, a folder of files for each format out."""

import importlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from vpsci_ros.data.episode import Episode
from vpsci_ros.episodes import open_source
from vpsci_ros.errors import InvalidInput
from vpsci_ros.runs.files import require_empty_folder
from vpsci_ros.runs.plugins import PluginGroup

VEHICLES = ("controllable", "trajectory")


@dataclass(frozen=True)
class Options:
    """What a user chooses.

    :ivar vehicle: "controllable": formats that can have a road user driven by somebody else (openscenario, commonroad)
        leave the vehicle to the tool that plays the episode; "trajectory": it drives as it did.
    :ivar road: name or file of the map that OpenSCENARIO files refer to, such as "Town10HD", instead of one made of
        the scenario's lane.
    """

    vehicle: str = "controllable"
    road: str = ""


@dataclass(frozen=True)
class Exporter:
    """How one format is written.

    :ivar module: its function `write(episodes, folder, options) -> number of files` is called, with the episodes of
        one source in order and a folder that is there and empty.
    :ivar extra: of this package, whose libraries the module imports; empty: none.
    """

    module: str
    extra: str = ""

    def load(self) -> Callable[[Iterable[Episode], Path, Options], int]:
        """Return the module's function.

        :raises InvalidInput: a library that it imports is not installed.
        """
        try:
            module = importlib.import_module(self.module)
        except ModuleNotFoundError as error:
            if (error.name or "").startswith("vpsci_ros"):
                raise
            raise InvalidInput(
                f"this format needs {error.name}, which is not installed: pip install 'vpsci_ros[{self.extra}]'"
            ) from None
        write: Callable[[Iterable[Episode], Path, Options], int] = module.write
        return write


EXPORTERS = PluginGroup(
    "vpsci_ros.exporters",
    "format",
    Exporter,
    {
        "openscenario": Exporter("vpsci_ros.export.openscenario", "openscenario"),
        "commonroad": Exporter("vpsci_ros.export.commonroad", "commonroad"),
        "osi": Exporter("vpsci_ros.export.osi", "osi"),
        "scenarionet": Exporter("vpsci_ros.export.scenarionet"),
        "carla-csv": Exporter("vpsci_ros.export.carla_csv"),
    },
)


def export(
    source: str | Path, formats: Sequence[str], folder: str | Path, options: Options = Options(), episodes: str = ""
) -> dict[str, int]:
    """Write the episodes of a source in each format to `folder`/FORMAT, and return the number of files of each.

    :param source: see `vpsci_ros.episodes.read_episodes`.
    :param episodes: only those whose number, name or label is in this list with commas; empty: all.
    :raises InvalidInput: an unknown format or option, a missing library, a source that is none, no such episode, or
        `folder` is not empty.
    """
    if options.vehicle not in VEHICLES:
        raise InvalidInput(f"vehicle {options.vehicle!r}: expected {' or '.join(VEHICLES)}")
    if not formats:
        raise InvalidInput(f"no format given; expected some of {', '.join(EXPORTERS.names())}")
    writers = {name: EXPORTERS.find(name).load() for name in formats}
    found = open_source(source)
    chosen = [text.strip() for text in episodes.split(",") if text.strip()]
    if not found.chosen(chosen):
        raise InvalidInput(f"{source}: holds no episode, so there is nothing to export")
    folder = require_empty_folder(folder)
    counts = {}
    for name, write in writers.items():
        (folder / name).mkdir()
        counts[name] = write(found.read(chosen), folder / name, options)
    return counts
