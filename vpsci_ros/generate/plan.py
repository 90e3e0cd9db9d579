"""The next unit to compute, and whether a scenario is complete.

A scenario's dataset is its episodes in the order of their numbers up to the last wanted kept one, so it does not depend
on the workers. Units are handed out in order. Episodes beyond the last one are discarded; the plan keeps them few by
the acceptance so far.
"""

import contextlib
import itertools
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vpsci_ros.data.dataset_index import DESCRIPTION
from vpsci_ros.data.episode_block import EpisodeBlock, block_from_bytes
from vpsci_ros.documents import read_json, require_form
from vpsci_ros.errors import InvalidInput, VpsciError
from vpsci_ros.generate.job import Unit
from vpsci_ros.runs.files import require_empty_folder, write_json
from vpsci_ros.runs.identity import require_same
from vpsci_ros.runs.output_folder import FolderLock

GIVE_UP = 100.0  # times the wanted episodes that may be rejected


class ScenarioPlan:
    """One scenario: its units, handed out and computed.

    :param target: kept episodes wanted.
    :param first: number of the first episode.
    :param size: episodes in a unit.
    """

    def __init__(self, scenario: int, target: int, first: int, size: int) -> None:
        self.scenario, self.target = scenario, target
        self._first, self._size = first, size
        self._kept: dict[int, int] = {}  # by place of the unit
        self._handed_out: set[int] = set()

    @property
    def simulated(self) -> int:
        """Episodes in the units that are computed."""
        return len(self._kept) * self._size

    @property
    def kept(self) -> int:
        """Kept episodes in the units that are computed."""
        return sum(self._kept.values())

    @property
    def acceptance(self) -> float:
        """Share of kept episodes, 1 before the first unit."""
        return self.kept / self.simulated if self._kept else 1.0

    @property
    def expected(self) -> float:
        """Expected kept episodes of all units handed out, as share of the target."""
        running = len(self._handed_out - self._kept.keys()) * self._size
        return (self.kept + running * self.acceptance) / self.target

    @property
    def complete(self) -> bool:
        """Whether the computed units, without a gap from the first one, have the wanted kept episodes."""
        return self.units_needed() is not None

    def units_needed(self) -> int | None:
        """Return the number of units, from the first one, that have the wanted kept episodes; None before."""
        kept = 0
        for place in range(len(self._kept)):
            if place not in self._kept:
                return None
            kept += self._kept[place]
            if kept >= self.target:
                return place + 1
        return None

    def unit(self, place: int) -> Unit:
        """Return the unit at a place, counted from 0."""
        begin = self._first + place * self._size
        return Unit(self.scenario, range(begin, begin + self._size))

    def hand_out(self) -> Unit:
        """Return the first unit that was not handed out yet."""
        place = next(place for place in itertools.count() if place not in self._handed_out)
        self._handed_out.add(place)
        return self.unit(place)

    def take(self, unit: Unit, kept: int) -> None:
        """Record a computed unit and the number of its kept episodes."""
        place = (unit.numbers[0] - self._first) // self._size
        self._handed_out.add(place)
        self._kept[place] = kept


class DatasetPlan:
    """All scenarios of a run.

    :param targets: kept episodes wanted by scenario.
    :param give_up: rejected episodes, in multiples of the target, after which a scenario fails.
    """

    def __init__(self, targets: Mapping[int, int], first: int, size: int, give_up: float = GIVE_UP) -> None:
        self.scenarios = {number: ScenarioPlan(number, target, first, size) for number, target in targets.items()}
        self._give_up = give_up

    @property
    def complete(self) -> bool:
        """Whether every scenario is."""
        return all(scenario.complete for scenario in self.scenarios.values())

    def next(self) -> Unit | None:
        """Return the next unit, of the scenario furthest behind; None while the units under way may suffice.

        :raises VpsciError: a scenario keeps next to nothing.
        """
        behind = [s for s in self.scenarios.values() if s.expected < 1.0 and not s.complete]
        if not behind:
            return None
        scenario = min(behind, key=lambda s: s.expected)
        if scenario.simulated - scenario.kept > self._give_up * scenario.target + 100:
            raise VpsciError(
                f"scenario {scenario.scenario}: {scenario.kept} of {scenario.simulated} episodes passed the filters, "
                f"{scenario.target} are wanted; loosen the filters"
            )
        return scenario.hand_out()


# ---- Finished units of a run, kept in the output folder, so that it resumes after Ctrl-C, a crash or a reboot.
#
# The hidden folder `.generate` has `run.json`, the identity of the run, and a file for each finished unit. A unit's
# file appears whole, by a rename. Damaged units fail their checksum and are recomputed. The folder is removed when
# the dataset is complete and its record written.


FOLDER, RECORD = ".generate", "generation.json"
RUN = "run.json"


class Journal:
    """The journal of one run; use `journal_of` to open it.

    :ivar unit: episodes in a unit of this run.
    """

    def __init__(self, folder: Path, unit: int) -> None:
        self._folder = folder
        self.unit = unit

    def path(self, unit: Unit) -> Path:
        """Return the path of a unit's file."""
        return self._folder / f"{unit.scenario}-{unit.numbers[0]:010d}.npz"

    def load(self, unit: Unit) -> EpisodeBlock | None:
        """Return a unit's episodes; None for an unfinished or damaged one, which is removed."""
        path = self.path(unit)
        if not path.is_file():
            return None
        try:
            return block_from_bytes(path.read_bytes(), str(path))
        except InvalidInput:
            path.unlink()
            return None

    def finished(self, scenario: int) -> list[int]:
        """Return the first numbers of a scenario's finished units."""
        return sorted(int(path.stem.partition("-")[2]) for path in self._folder.glob(f"{scenario}-*.npz"))

    def remove(self) -> None:
        """Remove the journal of a complete dataset."""
        shutil.rmtree(self._folder)


@contextlib.contextmanager
def journal_of(folder: Path, run: Mapping[str, Any], unit: int) -> Iterator[Journal | None]:
    """Open the journal of `run` in the output folder, begun or not; yields None where the run is complete.

    :param run: identity of the run, as JSON values.
    :param unit: episodes in a unit of a new run.
    :raises InvalidInput: the folder has another content, or another process uses it.
    """
    if (folder / DESCRIPTION).is_file() and ((folder / RECORD).is_file() or not (folder / FOLDER).is_dir()):
        require_same(folder, _read(folder / DESCRIPTION), run, "holds a dataset")
        shutil.rmtree(folder / FOLDER, ignore_errors=True)  # a run that was killed while it removed it
        yield None
        return
    with contextlib.closing(FolderLock(folder)):
        hidden = folder / FOLDER
        if not hidden.is_dir():
            require_empty_folder(folder)
            hidden.mkdir()
        if (hidden / RUN).is_file():
            begun = _read(hidden / RUN)
            require_same(folder, begun, run, "holds an unfinished run")
            unit = int(begun["unit"])
        else:
            write_json(hidden / RUN, {**run, "unit": unit})
        yield Journal(hidden, unit)


def _read(path: Path) -> dict[str, Any]:
    found = read_json(path)
    require_form(found, dict, f"{path}: not what a run writes; generate into another folder")
    return dict(found)
