"""The configuration of an exam: driving system, pedestrians and criteria."""

from dataclasses import dataclass

from vpsci_ros.data.episode import ALONE
from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import parameter
from vpsci_ros.policy.agent_types import AGENT_TYPES
from vpsci_ros.policy.policy_config import LEARNED

SEVERE_TTC = 1.0  # [s] a severe conflict is one with a CurvTTC below
MOVING = 0.5  # [m/s] a vehicle slower than this at the contact stood: the pedestrian walked into it
STANDS = 0.1  # [m/s] a vehicle slower than this stands
HARD_BRAKING = 3.5  # [m/s2] just above the 3.4 with which most drivers are comfortable (AASHTO, Geometric Design)
SILENT_TICKS = 20  # in a row without a usable command, after which an ADS has failed
SURPLUS_LIMIT = 100  # commands a tick beyond the first one; an ADS that sends more floods, and has failed
EXTERNAL = "external"  # an ADS that the user starts himself
PERSON = "you"  # a person drives (`vpsci drive`)
ADS, BASELINE = "ads", "autopilot"  # drivers of an exam: the system under test, and the autopilot beside it
DRIVERS = {
    LEARNED: "policy",
    "recorded": "replay",
    "walker": "autopilot",
    "constant_velocity": "constant_velocity",
    "social_force": "social_force",
}
"""Pedestrian -> the world's `pedestrian_driver`."""

TITLES = {
    LEARNED: "default pedestrian",
    "recorded": "recorded pedestrian",
    "walker": "walker, does not react",
    "constant_velocity": "constant velocity",
    "social_force": "social force",
    ALONE: "empty road",
}


def added_pedestrians() -> tuple[str, ...]:
    """Return the names of the agents that other installed Python packages add."""
    return tuple(name for name in AGENT_TYPES.names() if name != LEARNED)


def title_of(pedestrian: str) -> str:
    """Return a pedestrian's title in reports."""
    return TITLES.get(pedestrian, pedestrian)


OWN_TIMING, AUTOPILOTS_TIMING = "own", "autopilot"
TIMINGS = (OWN_TIMING, AUTOPILOTS_TIMING)
FAILURES = ("moving_collision", "collision", "conflict", "severe_conflict")
"""What counts as a failure: columns of the table of episodes."""


@dataclass(frozen=True)
class ExamConfig:
    """The exam of a driving system: the system, the pedestrians and the criteria."""

    ads: str = parameter("example_ads", "command that starts the driving system; external: you start it yourself")
    ads_class: str = parameter("", "MODULE:CLASS of a driving system in Python; replaces `ads`")
    pedestrians: list[str] = parameter(
        [name for name in DRIVERS if name != "recorded"],
        "pedestrians of the exam (docs/ads.md); also added agents (docs/extending.md)",
    )
    recorded: str = parameter(
        "", "near misses to replay as one more pedestrian: right_turns, right_turns/dev, or a Parquet file"
    )
    perception: bool = parameter(
        False, "true: pedestrians come on /perception/objects, with errors of perception, and not as odometry"
    )
    baseline: bool = parameter(True, "also drive the episodes with the rule-based autopilot, for comparison")
    fail_if: list[str] = parameter([], "criteria that fail the exam; --fail-if adds criteria to these")
    timing: str = parameter(
        OWN_TIMING,
        "own: pedestrians are timed to the system's drive on the empty road; autopilot: as drawn",
        choices=TIMINGS,
    )
    allow_standing: bool = parameter(False, "true: as --allow-standing")
    failure: str = parameter("moving_collision", "event that makes an episode a failure", choices=FAILURES)
    bags: bool = parameter(
        False, "also write bags of a system without ROS; the system then drives one episode at a time"
    )
    check_state: bool = parameter(
        True, "fail a class or a program behind a socket that keeps state from one episode to the next (docs/ads.md)"
    )

    def __post_init__(self) -> None:
        if not self.ads.strip():
            raise InvalidInput("ads is empty; give the command that starts the driving system, or 'external'")
        known = (*DRIVERS, *added_pedestrians())
        if unknown := [name for name in self.pedestrians if name not in known]:
            raise InvalidInput(f"pedestrians: unknown {unknown[0]!r}; expected {', '.join(known)}")
        if len(set(self.pedestrians)) < len(self.pedestrians):
            raise InvalidInput(f"pedestrians must be named once each, got {self.pedestrians}")
        if not self.pedestrians and not self.recorded:
            raise InvalidInput("pedestrians is empty; name at least one")
        if "recorded" in self.pedestrians and not self.recorded:
            raise InvalidInput(
                "pedestrians holds recorded, but no recordings are given; set 'recorded' to a near-miss table"
            )

    @property
    def examined(self) -> str:
        """The driving system: a command, or MODULE:CLASS."""
        return self.ads_class or self.ads

    @property
    def opponents(self) -> list[str]:
        """The names of the exam's pedestrians, in the order of `DRIVERS`, then those that other packages add."""
        names = {*self.pedestrians, *(["recorded"] if self.recorded else [])}
        return [name for name in (*DRIVERS, *added_pedestrians()) if name in names]
