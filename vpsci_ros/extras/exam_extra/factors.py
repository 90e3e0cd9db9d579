"""The factors that can be changed when a failed episode is repeated, and their ranges.

An episode is driven again from its seed with everything as it was but one thing, and the system drives in it. A factor
that cannot be varied for this system or episode has the reason.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from vpsci_ros.data.episode import Episode, Key
from vpsci_ros.exam.exam import Exam
from vpsci_ros.lockstep.intervention import BRAKING, NOT_FORCED, Intervention
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.kinematics import MAX_DECELERATION

LONGEST = 3.0  # [s] by which braking is made earlier at most


class Case(NamedTuple):
    """A failed episode, with the frames and accelerations that the factors need.

    :ivar end: frame of the contact, or of the least CurvTTC where there is none.
    :ivar onset: frame at which CurvTTC first falls below 5 s.
    :ivar braking: frame at which the last braking before the end begins; None: it does not brake after the onset.
    :ivar accelerations: of the vehicle from one frame to the next [m/s2].
    """

    key: Key
    episode: Episode
    end: int
    onset: int
    braking: int | None
    accelerations: tuple[float, ...]

    @property
    def name(self) -> str:
        """SCENARIO:NUMBER of the episode, such as 1:17."""
        return f"{self.key[0]}:{self.key[1]}"


class Span(NamedTuple):
    """The range in which a factor can be varied in a case.

    :ivar most: largest amount; 0: not at all, for the `reason`.
    :ivar step: amounts are multiples of it; 0: any.
    """

    most: float
    step: float = 0.0
    reason: str = ""


@dataclasses.dataclass(frozen=True)
class Factor:
    """A property that is changed when an episode is repeated.

    :ivar span: returns the range of amounts in a case of an exam.
    :ivar change: returns the exam in which each of some cases, all different episodes, is changed by its amount.
    :ivar shared: whether all cases of a run have one amount.
    """

    title: str
    unit: str
    definition: str
    span: Callable[[Case, Exam], Span]
    change: Callable[[Exam, Mapping[Key, tuple[Case, float]]], Exam]
    shared: bool = False


def case_of(episode: Episode) -> Case:
    """Return a failed episode with the frames and accelerations that the factors need."""
    seen = episode.filled()
    curvttc = np.nan_to_num(seen.curvttc.min(axis=0), nan=np.inf, posinf=np.inf)
    end = len(seen.speed) - 1 if episode.outcome == "collision" else int(curvttc.argmin())
    critical = np.flatnonzero(curvttc < CRITICAL_TTC)
    accelerations = np.diff(seen.speed) / episode.period
    onset = int(critical[0]) if len(critical) else 0
    brakes = np.flatnonzero(accelerations[:end] <= -BRAKING)
    spells = np.split(brakes, np.flatnonzero(np.diff(brakes) > 1) + 1)
    braking = int(spells[-1][0]) if len(brakes) and brakes[-1] >= onset else None
    return Case(episode.key, episode, end, onset, braking, tuple(accelerations.tolist()))


def _frames(seconds: float, case: Case) -> int:
    return round(seconds / case.episode.period)


def _span_earlier(case: Case, _: Exam) -> Span:
    if case.braking is None:
        return Span(0.0, reason="it did not brake between the onset and the contact")
    most = min(LONGEST, case.braking * case.episode.period)
    return Span(most, case.episode.period, "" if most else "it braked from the beginning")


def _brake_earlier(exam: Exam, cases: Mapping[Key, tuple[Case, float]]) -> Exam:
    changes = {}
    for key, (case, amount) in cases.items():
        assert case.braking is not None
        forced = tuple(a if a <= -BRAKING else NOT_FORCED for a in case.accelerations[case.braking : case.end])
        changes[key] = Intervention(case.braking - _frames(amount, case), forced=forced)
    return dataclasses.replace(exam, interventions=changes)


def _span_harder(case: Case, _: Exam) -> Span:
    if case.braking is None:
        return Span(0.0, reason="it did not brake between the onset and the contact")
    room = MAX_DECELERATION + min(case.accelerations[case.braking : case.end])
    return Span(room if room > 0.1 else 0.0, reason="" if room > 0.1 else "it braked as hard as the car can")


def _brake_harder(exam: Exam, cases: Mapping[Key, tuple[Case, float]]) -> Exam:
    return dataclasses.replace(
        exam, interventions={key: Intervention(firmer=amount) for key, (_, amount) in cases.items()}
    )


def _span_full(case: Case, _: Exam) -> Span:
    most = min(LONGEST, case.end * case.episode.period)
    return Span(most, case.episode.period, "" if most else "it begins with the contact")


def _brake_fully(exam: Exam, cases: Mapping[Key, tuple[Case, float]]) -> Exam:
    forced = {key: _frames(amount, case) for key, (case, amount) in cases.items()}
    changes = {
        key: Intervention(case.end - forced[key], forced=(-MAX_DECELERATION,) * forced[key])
        for key, (case, _) in cases.items()
    }
    return dataclasses.replace(exam, interventions=changes)


def _span_slower(case: Case, _: Exam) -> Span:
    speed = float(case.episode.filled().speed[case.onset])
    return Span(speed if speed > 0.05 else 0.0, reason="" if speed > 0.05 else "the vehicle stood at the onset")


def _slow_down(exam: Exam, cases: Mapping[Key, tuple[Case, float]]) -> Exam:
    return dataclasses.replace(
        exam, interventions={key: Intervention(case.onset, speed=-amount) for key, (case, amount) in cases.items()}
    )


def _span_latency(_: Case, exam: Exam) -> Span:
    if exam.latency is None:
        return Span(0.0, reason="nothing comes late: in lock-step a command counts at the tick that it answers, and "
                                "ads_test.perception is off")  # fmt: skip
    return Span(exam.latency, exam.world.tick, "" if exam.latency else "perception.latency is 0")


def _sooner(exam: Exam, cases: Mapping[Key, tuple[Case, float]]) -> Exam:
    ((_, amount), *_) = cases.values()
    late = max(0.0, (exam.latency or 0.0) - amount)
    return dataclasses.replace(exam, sections=exam.sections.changed("perception", {"latency": round(late, 6)}))


FACTORS = {
    "earlier": Factor(
        "braking earlier", "s", "the same braking before the contact, this much earlier; the system may brake "
        "harder, and controls the car before and after", _span_earlier, _brake_earlier),
    "harder": Factor(
        "braking harder", "m/s2", "this much is added to each commanded deceleration of at least 1 m/s2, up to the "
        "car's 8.88", _span_harder, _brake_harder),
    "full": Factor(
        "full braking before the contact", "s", "8.88 m/s2 from this time before the contact on, instead of the "
        "command: the latest time at which braking avoids it", _span_full, _brake_fully),
    "slower": Factor(
        "slower at the onset", "m/s", "the speed is this much lower when CurvTTC first falls below 5 s, at the same "
        "positions; the system drives on from there", _span_slower, _slow_down),
    "latency": Factor(
        "less latency", "s", "pedestrians are published to the system this much earlier (perception.latency)",
        _span_latency, _sooner, shared=True),
}  # fmt: skip
"""Name of a factor -> what is changed; one at a time."""
