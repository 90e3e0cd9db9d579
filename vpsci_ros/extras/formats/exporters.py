"""The entry point of the exporters: from a source and names of formats to a folder of files for each format."""

import importlib
import shutil
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.documents import given_names
from vpsci_ros.errors import InvalidInput, packages_of
from vpsci_ros.exam.exam import ALONE
from vpsci_ros.exam.result import EpisodeFile, exam_runs
from vpsci_ros.exam.view import is_exam
from vpsci_ros.resources import near_misses_part
from vpsci_ros.runs.files import require_empty_folder
from vpsci_ros.runs.plugins import PluginGroup
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.run_folder import RunFolder
from vpsci_ros.view.episode_sources import EpisodeSource, open_source

VEHICLES = ("controllable", "trajectory")
_UNFINISHED = ".unfinished"  # folder of an export, until it is whole


@dataclass(frozen=True)
class Options:
    """Options of an export that the user sets.

    :ivar vehicle: "controllable": formats that can have a road user driven by somebody else (openscenario, commonroad)
        leave the vehicle to the tool that plays the episode; "trajectory": it drives as it did.
    :ivar road: name or file of the map that OpenSCENARIO files refer to, such as "Town10HD", instead of one made of
        the scenario's lane.
    """

    vehicle: str = "controllable"
    road: str = ""


@dataclass(frozen=True)
class Exporter:
    """A format of episodes that `vpsci export` writes.

    :ivar module: its function `write(episodes, folder, options) -> number of files` is called, with the episodes of
        one source in order and an empty folder.
    :ivar extra: of this package, whose libraries the module imports; empty: none.
    """

    module: str
    extra: str = ""

    def load(self) -> Callable[[Iterable[Episode], Path, Options], int]:
        """Return the module's function `write`.

        :raises InvalidInput: a library that it imports is not installed.
        """
        try:
            module = importlib.import_module(self.module)
        except ModuleNotFoundError as error:
            if (error.name or "").startswith("vpsci_ros"):
                raise
            hint = f": pip install {packages_of(self.extra)}" if self.extra else ""
            raise InvalidInput(f"this format needs {error.name}, which is not installed{hint}") from None
        write: Callable[[Iterable[Episode], Path, Options], int] = module.write
        return write


EXPORTERS = PluginGroup(
    "vpsci_ros.exporters",
    "format",
    Exporter,
    {
        "openscenario": Exporter("vpsci_ros.extras.formats.openscenario", "formats"),
        "commonroad": Exporter("vpsci_ros.extras.formats.commonroad", "commonroad"),
        "lanelet2": Exporter("vpsci_ros.extras.formats.lanelet2"),
        "osi": Exporter("vpsci_ros.extras.formats.osi", "formats"),
        "scenarionet": Exporter("vpsci_ros.extras.formats.scenarionet"),
        "mp4": Exporter("vpsci_ros.extras.formats.mp4", "formats"),
    },
)


def export(
    source: str | Path, formats: Sequence[str], folder: str | Path, options: Options = Options(), episodes: str = ""
) -> dict[str, int]:
    """Write the episodes of a source in each format to `folder`/FORMAT, and return the number of files of each.

    Each of these folders is a run of its own, with its record, so that another format can be added later.

    :param source: of episodes (`vpsci_ros.view.episode_sources`), or the folder of an exam.
    :param episodes: only those whose number, name or label is in this list with commas; empty: all.
    :raises InvalidInput: an unknown format or option, a missing library, a source that is none, no such episode,
        `folder` holds anything but folders of formats, or `folder`/FORMAT anything else than what the same command
        wrote; only formats named before it are written.
    """
    if options.vehicle not in VEHICLES:
        raise InvalidInput(f"vehicle {options.vehicle!r}: expected {' or '.join(VEHICLES)}")
    if not formats:
        raise InvalidInput(f"no format given; expected some of {', '.join(EXPORTERS.names())}")
    writers = {name: EXPORTERS.find(name).load() for name in formats}
    found = open_exam(Path(source)) if is_exam(Path(source)) else open_source(source)
    chosen = given_names(episodes, "--episodes")
    if not found.chosen(chosen):
        raise InvalidInput(f"{source}: holds no episode, so there is nothing to export")
    root, _ = near_misses_part(source)
    inputs = [root] if root.is_file() else sorted(path for path in root.rglob("*") if path.is_file())
    given = {"source": str(source), "episodes": chosen} | asdict(options)
    require_empty_folder(folder, *EXPORTERS.names())
    counts = {}
    for name, write in writers.items():
        run = RunFolder(Path(folder, name), Sections({"export": given}), inputs)
        counts[name] = run.results.get("files", 0)
        if run.done:
            continue
        with run:
            unfinished = Path(folder, name, _UNFINISHED)
            shutil.rmtree(unfinished, ignore_errors=True)
            unfinished.mkdir()
            run.results["files"] = counts[name] = write(found.read(chosen), unfinished, options)
            for path in [path for path in unfinished.rglob("*") if not path.is_dir()]:
                (target := Path(folder, name, path.relative_to(unfinished))).parent.mkdir(parents=True, exist_ok=True)
                path.replace(target)
            shutil.rmtree(unfinished)
    return counts


def open_exam(folder: Path) -> EpisodeSource:
    """Return the episodes of all runs with a pedestrian; their names begin with the pedestrian's: "learned/6:12".

    :raises InvalidInput: no run is finished, or a file cannot be read.
    """
    files = [(pedestrian, EpisodeFile(path)) for pedestrian, path in exam_runs(folder) if pedestrian != ALONE]
    listed = [_with(pedestrian, one) for pedestrian, file in files for one in file.listed]
    if not listed:
        raise InvalidInput(f"{folder}: an exam without a finished run; let it come to its end")

    def read(wanted: Collection[str]) -> Iterator[Episode]:
        for pedestrian, file in files:
            if any(_with(pedestrian, one).name in wanted for one in file.listed):
                for episode in file.read():
                    if (one := _with(pedestrian, episode.listed)).name in wanted:
                        yield replace(episode, listed=one)

    return EpisodeSource(folder, "exam", files[0][1].period, listed, read)


def _with(pedestrian: str, listed: Listed) -> Listed:
    return listed._replace(name=f"{pedestrian}/{listed.name}", group=f"{pedestrian}_{listed.group}")
