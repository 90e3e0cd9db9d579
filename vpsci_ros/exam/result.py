"""The result of a run of an exam: its episodes, whatever the driving system was, and how the run went."""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow.parquet as pq

from vpsci_ros.data.dataset_tables import ENCODING, EPISODE_COLUMNS, arrow_rows, block_of_rows, episode_columns
from vpsci_ros.data.episode import Episode, Key, Listed
from vpsci_ros.data.episode_block import EpisodeBlock, SeenTick, concat_blocks, ended_blocks
from vpsci_ros.data.parquet import arrow_schema, read_metadata, read_parquet
from vpsci_ros.documents import reason
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.exam import Exam
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world import Scenario
from vpsci_ros.world.scenario import every_scenario, own_documents

FRAMES = "frames.parquet"  # of a run


@dataclasses.dataclass(frozen=True)
class Conduct:
    """Counts of refused and surplus commands and of safe stops in a run of the ADS, and why the run failed.

    :ivar wanted: episodes that it was to drive.
    :ivar refused: commands that the world refused: not finite, out of range, or late.
    :ivar surplus: good commands beyond the first one at a tick.
    :ivar safe_stops: in real time, how often the world braked because no command came.
    :ivar failure: empty, or why it did not drive all of them.
    """

    wanted: int
    refused: int = 0
    surplus: int = 0
    safe_stops: int = 0
    failure: str = ""


class FirstCritical(NamedTuple):
    """The first critical pedestrian of an episode: its kind, and whether parked vehicles hid it.

    :ivar hidden: parked vehicles hid the pedestrian.
    :ivar kind: of the pedestrian, one of `KINDS`.
    :ivar pedestrians: of the episode.
    """

    hidden: bool = False
    kind: str = ""
    pedestrians: int = 0


class RunResult(NamedTuple):
    """The result of a driver's run with one pedestrian.

    :ivar episodes: that ended.
    :ivar conduct: how it went, apart from how the driver drove.
    :ivar unanswered: ticks without a usable command, for the episodes that had any.
    """

    episodes: Sequence[Episode]
    conduct: Conduct = Conduct(0)
    unanswered: Mapping[Key, int] = {}


def first_critical(episode: Episode) -> FirstCritical:
    """Return who became critical first; the default where nobody did."""
    critical = episode.known_curvttc < CRITICAL_TTC
    if not critical.any():
        return FirstCritical()
    frame = int(critical.any(axis=0).argmax())
    who = int(critical[:, frame].argmax())
    kind = episode.kinds[who] if episode.kinds else ""
    return FirstCritical(not episode.seen[who, frame], kind, episode.pedestrians)


def block_of_ticks(ticks: Iterable[SeenTick], scenarios: Sequence[Scenario]) -> EpisodeBlock:
    """Return the episodes that end in a run's ticks, sorted by key."""
    return concat_blocks(list(ended_blocks(ticks, scenarios)))


def write_episodes(path: Path, block: EpisodeBlock, period: float, scenarios: Sequence[Scenario], **facts: Any) -> None:
    """Write simulated episodes as one Parquet file in float64, from which they are read bit-identically.

    :param period, scenarios: see `EpisodeBlock.episodes`.
    :param facts: JSON values that `EpisodeFile` returns by these names.
    """
    found, numbers = list(block.described(scenarios)), set(block.records["scenario"].tolist())
    facts |= {
        "listed": [listed for listed, _, _ in found],
        "kinds": [kinds for _, kinds, _ in found],
        "period": period if found else 0.0,
        "own_scenarios": own_documents(each for each in scenarios if each.number in numbers),
    }
    rows = arrow_rows(block).cast(arrow_schema(episode_columns(np.float64), facts))
    with atomic_write(path) as part:
        pq.write_table(rows, part, write_page_checksum=True, **ENCODING)


class EpisodeFile:
    """Simulated episodes in one Parquet file, as `write_episodes` writes it.

    :ivar facts: what else was stored.
    :ivar listed: the episodes without their motion.
    :ivar period: time from one frame to the next [s].
    :raises InvalidInput: it cannot be read, or holds something else.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.facts = path, read_metadata(path)
        try:
            self.listed = [Listed(*each) for each in self.facts["listed"]]
            self.period = float(self.facts["period"])
            self._kinds = {one.key: tuple(kinds) for one, kinds in zip(self.listed, self.facts["kinds"], strict=True)}
            self._roads = {road.name: road for road in every_scenario(self.facts["own_scenarios"], str(path))}
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidInput(f"{path}: not readable as episodes of a run ({reason(error)}); drive it again") from None

    def read(self) -> Iterator[Episode]:
        """Yield the episodes.

        :raises InvalidInput: the rows cannot be read.
        """
        block = block_of_rows(read_parquet(self.path, "the episodes of a run", EPISODE_COLUMNS), self.path)
        listed = {one.key: one for one in self.listed}
        for key, values in block.motions():
            if (one := listed.get(key)) is not None:
                of = str(self.path), one, self._roads.get(one.group), self.period
                yield Episode.from_values(*of, values, kinds=self._kinds[key])


def write_result(
    run: Path, exam: Exam, block: EpisodeBlock, conduct: Conduct, unanswered: Mapping[Key, int] | None = None
) -> None:
    """Write the result of a run of an exam into its folder, see `RunResult`, whole or not at all."""
    facts = {
        "conduct": dataclasses.asdict(conduct),
        "unanswered": [[*key, count] for key, count in (unanswered or {}).items()],
    }
    write_episodes(run / FRAMES, block, exam.world.tick, exam.scenarios, **facts)


def read_result(folder: Path, pedestrian: str, part: int = 0) -> RunResult:
    """Return the result of a run of the exam in `folder`.

    :raises InvalidInput: it cannot be read, or the file holds something else.
    """
    path = run_folder(folder, pedestrian, part) / FRAMES
    file = EpisodeFile(path)
    try:
        conduct = Conduct(**file.facts["conduct"])
        unanswered = {(scenario, episode): count for scenario, episode, count in file.facts["unanswered"]}
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidInput(f"{path}: not readable as the result of a run ({error}); drive it again") from None
    return RunResult(list(file.read()), conduct, unanswered)


def label_of(pedestrian: str, part: int) -> str:
    """Return the name of a run: walker-1, walker-2, walker-3 for the parts of an exam."""
    return f"{pedestrian}-{part + 1}"


def run_folder(folder: Path, pedestrian: str, part: int) -> Path:
    """Return the folder of a run of the exam in `folder`: runs/walker/1 for the first part."""
    return folder / "runs" / pedestrian / str(part + 1)


def exam_runs(folder: Path) -> list[tuple[str, Path]]:
    """Return pedestrian and file of each run in an exam's folder, by name and part."""
    paths = (path for path in folder.glob(f"runs/*/*/{FRAMES}") if path.parts[-2].isdecimal())  # no copy of one
    ordered = sorted(paths, key=lambda path: (path.parts[-3], int(path.parts[-2])))
    return [(path.parts[-3], path) for path in ordered]
