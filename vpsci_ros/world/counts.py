"""What a world counts while it keeps step with its peers: one record, from where it is counted to the exit status."""

from dataclasses import asdict, dataclass
from typing import Literal, NamedTuple

from vpsci_ros.world.state import PEDESTRIAN_ACTION_MISSING, SAFETY_MISSING, VEHICLE_ACTION_MISSING

MISSING_ANSWERS = {VEHICLE_ACTION_MISSING: "vehicle", PEDESTRIAN_ACTION_MISSING: "pedestrian", SAFETY_MISSING: "safety"}
"""Kind of event -> whose answer was missing."""
Fault = Literal["missing", "refused", "contradicted", "early"]


class Faults(NamedTuple):
    """How many answers of one respondent were missing, refused, other than the first one, or ahead of their tick."""

    missing: int
    refused: int
    contradicted: int
    early: int


@dataclass
class WorldCounts:
    """Numbers of ticks, episodes, answers, commands and outcomes, by the keys that they have in the diagnostics.

    Of answers to a tick, by the safety monitor and the drivers of the agents: `missing` when the world went on without
    (`action_timeout`); `refused`, of wrong lengths or not finite; `contradicted`, a later one that differs from the
    first; `early`, to a tick that was still to come. The last two are another program's.
    """

    tick: int = 0  # the present one
    episodes_ended: int = 0  # of those requested, since the last reset
    resets: int = 0
    late_ticks: int = 0  # the wall clock set the pace, and the tick before was not over
    safety_answers_missing: int = 0
    safety_answers_refused: int = 0
    safety_answers_contradicted: int = 0
    safety_answers_early: int = 0
    vehicle_answers_missing: int = 0
    vehicle_answers_refused: int = 0
    vehicle_answers_contradicted: int = 0
    vehicle_answers_early: int = 0
    pedestrian_answers_missing: int = 0
    pedestrian_answers_refused: int = 0
    pedestrian_answers_contradicted: int = 0
    pedestrian_answers_early: int = 0
    vehicle_commands: int = 0  # of an external driving system: accepted
    vehicle_commands_surplus: int = 0  # accepted after another one to the same tick
    vehicle_commands_refused: int = 0  # late, out of range or not finite
    vehicle_commands_early: int = 0  # before the first tick
    safe_stops: int = 0  # begun because no command came, in real time
    safe_stop_ticks: int = 0
    collision: int = 0  # episodes by outcome, also those that a reset began again
    goal: int = 0
    timeout: int = 0
    parked_collision: int = 0

    def add(self, name: str, number: int = 1) -> None:
        """Add to the count of this name."""
        setattr(self, name, getattr(self, name) + number)

    def add_fault(self, sender: str, fault: Fault, number: int = 1) -> None:
        """Count answers of "safety", "vehicle" or "pedestrian" that are not as they should be."""
        self.add(f"{sender}_answers_{fault}", number)

    def faults(self, sender: str) -> Faults:
        """Return what was counted of the answers of "safety", "vehicle" or "pedestrian"."""
        return Faults(*(getattr(self, f"{sender}_answers_{fault}") for fault in Faults._fields))

    def nonzero(self) -> dict[str, int]:
        """Return the counts that are not 0, by name."""
        return {name: count for name, count in asdict(self).items() if count}
