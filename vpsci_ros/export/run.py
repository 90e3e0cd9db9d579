"""The door of the exporters: a source and names of formats in, a folder of files for each format out."""

import importlib
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from vpsci_ros.data.episode import Episode
from vpsci_ros.episodes import open_source
from vpsci_ros.errors import InvalidInput
from vpsci_ros.resources import near_misses_part
from vpsci_ros.runs.folder import RunFolder
from vpsci_ros.runs.plugins import PluginGroup
from vpsci_ros.runs.sections import Sections

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
        "minari": Exporter("vpsci_ros.export.minari"),
        "mp4": Exporter("vpsci_ros.export.mp4", "video"),
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
        `folder` holds anything else than what the same command wrote.
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
    folder, (root, _) = Path(folder), near_misses_part(source)
    inputs = [root] if root.is_file() else sorted(path for path in root.rglob("*") if path.is_file())
    given = {"source": str(source), "formats": list(formats), "episodes": chosen} | asdict(options)
    run = RunFolder(folder, Sections({"export": given}), inputs)
    if run.done:
        return run.results
    with run:
        for name, write in writers.items():
            shutil.rmtree(folder / name, ignore_errors=True)  # what the same command left there, stopped or damaged
            (folder / name).mkdir()
            run.results[name] = write(found.read(chosen), folder / name, options)
    return run.results
