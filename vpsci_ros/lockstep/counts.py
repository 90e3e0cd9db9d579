"""Counts of a world in lock-step: ticks, episodes, faulty answers, commands and outcomes."""

from dataclasses import asdict, dataclass
from typing import Literal, get_args

from vpsci_ros.world.state import PEDESTRIAN_ACTION_MISSING, SAFETY_MISSING, VEHICLE_ACTION_MISSING

MISSING_ANSWERS = {VEHICLE_ACTION_MISSING: "vehicle", PEDESTRIAN_ACTION_MISSING: "pedestrian", SAFETY_MISSING: "safety"}
"""Kind of event -> the sender whose answer was missing."""
Fault = Literal["missing", "refused", "contradicted", "early"]


@dataclass
class WorldCounts:
    """Counts of ticks, episodes, answers, commands and outcomes, by their keys in the diagnostics.

    Answers of the safety monitor and the drivers to a tick are `missing` after `action_timeout`; `refused` for wrong
    lengths or values that are not finite; `contradicted` if they differ from the first one; `early` for a future tick.
    Another program sent the last two.
    """

    tick: int = 0  # the present one
    episodes_ended: int = 0
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
    vehicle_commands_ahead: int = 0  # of the refused ones: stamped ahead of simulated time, as by the wall clock
    vehicle_commands_early: int = 0  # before the first tick
    safe_stops: int = 0  # begun because no command came, in real time
    safe_stop_ticks: int = 0
    collision: int = 0  # episodes by outcome
    goal: int = 0
    timeout: int = 0
    parked_collision: int = 0

    def add(self, name: str, number: int = 1) -> None:
        """Add `number` to the count `name`."""
        setattr(self, name, getattr(self, name) + number)

    def add_fault(self, sender: str, fault: Fault, number: int = 1) -> None:
        """Count faulty answers of "safety", "vehicle" or "pedestrian"."""
        self.add(f"{sender}_answers_{fault}", number)

    def faults(self, sender: str) -> dict[Fault, int]:
        """Return the counts of faulty answers of "safety", "vehicle" or "pedestrian", by kind of fault."""
        return {fault: getattr(self, f"{sender}_answers_{fault}") for fault in get_args(Fault)}

    def nonzero(self) -> dict[str, int]:
        """Return the counts that are not 0, by name."""
        return {name: count for name, count in asdict(self).items() if count}
