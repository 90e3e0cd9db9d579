"""The result of a run of an exam: its episodes, whatever the driving system was, and how the run went.

Ticks of the loop and ticks of a bag become the same value, which is stored as one file.
"""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from vpsci_ros.data.episode import Episode, Key
from vpsci_ros.data.episode_file import read_episode_file, write_episodes
from vpsci_ros.data.gathered import SeenTick, gathered
from vpsci_ros.data.parquet import read_metadata
from vpsci_ros.errors import InvalidInput
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world import IDLE, Scenario
from vpsci_ros.world.kinds import KINDS
from vpsci_ros.world.parked import in_sight, parked_from


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
    :ivar first_critical: who became critical first, of the episodes that were critical.
    """

    episodes: Sequence[Episode]
    conduct: Conduct = Conduct(0)
    unanswered: Mapping[Key, int] = {}
    first_critical: Mapping[Key, FirstCritical] = {}


def result_of_ticks(ticks: Iterable[SeenTick], period: float, scenarios: Sequence[Scenario], source: str) -> RunResult:
    """Return the result in a run's ticks: episodes sorted by key, and the first critical pedestrian of critical ones.

    :param period: of a tick [s].
    :param source: what the ticks come from, the opening of an error message.
    """
    first_critical: dict[Key, FirstCritical] = {}
    parked = parked_from(scenarios)

    def watched() -> Iterator[SeenTick]:
        for tick in ticks:
            state = tick.state
            critical = (state["status"] != IDLE) & (tick.curvttc < CRITICAL_TTC)
            visible = in_sight(state, parked) if critical.any() else critical
            for record, seen in zip(state[critical], visible[critical].tolist(), strict=True):
                first = FirstCritical(not seen, KINDS[record["kind"]], max(1, int(record["pedestrians"])))
                first_critical.setdefault((int(record["scenario"]), int(record["episode"])), first)
            yield tick

    found = sorted(gathered(watched(), period, scenarios, source=source), key=lambda episode: episode.key)
    return RunResult(found, first_critical=first_critical)


def write_result(path: Path, result: RunResult) -> None:
    """Write the result of a run, whole or not at all."""
    write_episodes(
        path,
        result.episodes,
        conduct=dataclasses.asdict(result.conduct),
        unanswered=[[*key, count] for key, count in result.unanswered.items()],
        first_critical=[[*key, *seen] for key, seen in result.first_critical.items()],
    )


def read_result(path: Path) -> RunResult:
    """Return the result of a run.

    :raises InvalidInput: it cannot be read, or the file holds something else.
    """
    episodes, facts = read_episode_file(path), read_metadata(path)
    try:
        return RunResult(
            episodes,
            Conduct(**facts["conduct"]),
            {(scenario, episode): count for scenario, episode, count in facts["unanswered"]},
            {(scenario, episode): FirstCritical(*seen) for scenario, episode, *seen in facts["first_critical"]},
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidInput(f"{path}: not readable as the result of a run ({error}); drive it again") from None


def label_of(pedestrian: str, part: int) -> str:
    """Return the name of a run's folder: walker, walker-2, walker-3."""
    return f"{pedestrian}-{part + 1}" if part else pedestrian


def run_folder(folder: Path, pedestrian: str, part: int) -> Path:
    """Return the folder of a run of the exam in `folder`."""
    return folder / "runs" / label_of(pedestrian, part)
