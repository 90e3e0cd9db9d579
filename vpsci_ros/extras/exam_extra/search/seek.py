"""The search: drive, train and simulate the surrogate, drive likely failures, and estimate their number."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Key
from vpsci_ros.data.episode_block import ended_episodes
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.exam import DRIVERS, Exam, added_pedestrians
from vpsci_ros.exam.run import loop_with
from vpsci_ros.extras.exam_extra.search.imitation import Floats32, Imitation, Recent
from vpsci_ros.extras.exam_extra.search.margin import least_margin
from vpsci_ros.extras.exam_extra.search.plan import Plan
from vpsci_ros.extras.exam_extra.search.risk import Floats
from vpsci_ros.world.tick import Actions, Assessment, Tick

_BATCH = 1024  # episodes rehearsed side by side
Report = Callable[[str, int, int], None]
"""Called with what is done, how much of it, and how much there is."""


@dataclass(frozen=True)
class SearchConfig:
    """Parameters of a search: pedestrian, number of episodes in the pool, number that the system drives."""

    pedestrian: str
    pool: int
    budget: int

    def __post_init__(self) -> None:
        known = [name for name in (*DRIVERS, *added_pedestrians()) if name != "recorded"]
        if self.pedestrian not in known:
            raise InvalidInput(f"--pedestrian: unknown {self.pedestrian!r}; expected {', '.join(known)}")
        if self.budget > self.pool:
            raise InvalidInput(f"--budget {self.budget} exceeds --pool {self.pool}; there is nothing to search then")


class Driven(NamedTuple):
    """The result of one part of a search.

    :ivar episodes: that were driven: those requested, or those of the same part before the search was stopped.
    :ivar failed: bool[k].
    :ivar seen, done: what the vehicle saw and did, see `imitation.lessons`.
    """

    episodes: list[Key]
    failed: NDArray[np.bool_]
    seen: Floats32
    done: Floats32


def seek(
    exam: Exam, search: SearchConfig, pool: list[Key], drive: Callable[[str, list[Key]], Driven], report: Report
) -> Plan:
    """Search a pool of episodes, and return the driven episodes and the estimates for the rest.

    :param drive: has the driving system drive the episodes of a part, by its name.
    """
    place = {key: number for number, key in enumerate(pool)}
    plan = Plan(len(pool), search.budget, exam.run.seed)
    seen, done = [], []
    for name, chosen, learns in plan.parts():
        driven = drive(name, [pool[number] for number in chosen])
        plan.take(np.array([place[key] for key in driven.episodes]), driven.failed)
        if not learns:
            continue
        seen.append(driven.seen)
        done.append(driven.done)
        report("learning how it drives", 0, 1)
        stand_in = Imitation(np.concatenate(seen), np.concatenate(done), exam.run.seed)
        report("learning how it drives", 1, 1)
        rest = np.flatnonzero(~plan.driven)
        margin, left = np.full(len(pool), np.nan), [pool[number] for number in rest]
        margin[rest] = rehearse(exam, search.pedestrian, left, stand_in, report)
        plan.rehearsed(margin)
    return plan


def rehearse(exam: Exam, pedestrian: str, episodes: list[Key], driver: Imitation, report: Report) -> Floats:
    """Return the least margin of each episode when the surrogate drives, float64[n]."""
    loop = loop_with(exam, pedestrian, "external", episodes, _BATCH)
    most = exam.world.pedestrians
    recent, least = Recent(most), dict[Key, float]()

    def answers(tick: Tick, assessment: Assessment) -> Actions:
        features, rows = recent.features(tick.state, assessment.curvttc)
        answer = np.zeros((len(rows), 2))
        answer[:, 0] = driver.drive(features)
        return Actions(vehicle=np.repeat(answer, most, axis=0))

    with driver.one_thread():
        for episode in ended_episodes(loop.ticks(answers), exam.world.tick, exam.scenarios):
            least[episode.key] = least_margin(exam.config.failure, episode)
            report("rehearsing", len(least), len(episodes))
    return np.array([least[key] for key in episodes])
