"""Commands of an external driving system: checked and held, with a safe stop when they cease."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.world.state import EPISODE, EVENT, NO_EVENTS, RUNNING, SAFE_STOP
from vpsci_ros.world.tick import NO_ACTIONS, Actions, Tick

ANSWERS_TO_A_REPETITION = 2  # to its odometry, and to the list of objects
COMMAND_SILENCE = 0.5  # [s] of simulated time without a command, in real time, after which the vehicle brakes
SAFE_STOP_DECELERATION = 5.0  # [m/s2] in the end
SAFE_STOP_JERK = 5.0  # [m/s3] at which a safe stop builds up; half of what people brake with (`people.JERK`)
LARGEST_ACCELERATION = 50.0  # [m/s2] beyond any vehicle's: a sign of wrong units
RANGES = {
    "vehicle": ((-LARGEST_ACCELERATION, LARGEST_ACCELERATION),) * 2,
    "vehicle_control": ((-1.0, 1.0), (0.0, 1.0), (0.0, 1.0)),
}
"""Form of a command -> ranges of (longitudinal, lateral) [m/s2], or of (steer, throttle, brake)."""


def form_of(values: Sequence[float]) -> str:
    """Return the form of a command, a key of `RANGES`; "" for numbers that are none, or out of its range."""
    for form, ranges in RANGES.items():
        if len(values) == len(ranges):
            return form if all(low <= x <= high for x, (low, high) in zip(values, ranges, strict=True)) else ""
    return ""


class ExternalDriver:
    """Holds the external command for the present tick of one episode.

    In lock-step the command has to answer the present tick, and the world waits for it. In real time the last good
    command holds; when it is older than `COMMAND_SILENCE`, the vehicle brakes, more and more firmly, until commands
    come again.

    A command is refused and counted when it is not finite, out of range, for a tick that is still to come, or too old:
    stamped before the present tick (lock-step), or longer than `COMMAND_SILENCE` ago or before the last command (real
    time). Stamps are nanoseconds of simulated time; None means the present.

    :param real_time: the world does not wait for commands.
    :param period: of a tick [s].
    :param counts: counts of commands and safe stops.
    :ivar present: returns whether a publisher of commands exists.
    """

    def __init__(self, real_time: bool, period: float, counts: WorldCounts) -> None:
        self.real_time = real_time
        self.present: Callable[[], bool] = lambda: True
        self._counts = counts
        self._tick_time = round(period * 1e9)  # [ns]
        self._now = 0  # [ns] of the present tick
        self._repeated = (0, 0)  # a tick [ns] that was, and how many late answers to it are passed over
        self._stamp = 0  # [ns] of the latest command
        self._commanded: int | None = None  # [ns] when the latest command came
        self._command = NO_ACTIONS
        self._idle_ticks: deque[int] = deque(maxlen=8)  # [ns], the last ticks without an episode
        self._fresh = False
        self._given_up = False
        self._stopping = False

    @property
    def answered(self) -> bool:
        """Whether the world need not wait; after a tick without a command it waits only for a present publisher."""
        return self.real_time or self._fresh or (self._given_up and not self.present())

    def begin(self, tick: Tick, *, running: bool = True) -> None:
        """Begin a tick; in lock-step, the command of the last tick is dropped.

        :param running: whether an episode runs; an answer to a tick without one is neither used nor counted.
        """
        self._now = tick.number * self._tick_time
        if not running:
            self._idle_ticks.append(self._now)
        if not self.real_time:
            self._given_up = not self._fresh and running
            self._command = NO_ACTIONS
        elif self._commanded is None:
            self._commanded, self._command = self._now, Actions(np.zeros((1, 2)))  # rolls until a command comes
        self._fresh = False

    def repeat(self) -> None:
        """Mark the present tick as published again, so that late answers to it are no fault."""
        stamp, answers = self._repeated
        self._repeated = self._now, (answers if stamp == self._now else 0) + ANSWERS_TO_A_REPETITION

    def drive(self, state: NDArray[np.void]) -> tuple[Actions, NDArray[np.void]]:
        """Return the command to execute at the present tick, and the events to publish, EVENT[n].

        :param state: EPISODE[B], the rows of one episode, all of which get the command.
        """
        if not self.real_time or self._commanded is None or state["status"][0] != RUNNING:
            return _in_all(self._command, len(state)), NO_EVENTS
        silence = (self._now - self._commanded) / 1e9 - COMMAND_SILENCE
        if silence <= 0.0:
            self._stopping = False
            return _in_all(self._command, len(state)), NO_EVENTS
        self._counts.safe_stop_ticks += 1
        braking = min(SAFE_STOP_DECELERATION, SAFE_STOP_JERK * silence)
        begins = not self._stopping or state["frame"][0] == 0
        self._stopping = True
        return _in_all(Actions(np.array([[-braking, 0.0]])), len(state)), self._safe_stop(
            state[:1]
        ) if begins else NO_EVENTS

    def accelerate(self, values: Sequence[float], stamp: int | None = None) -> None:
        """Store a command (longitudinal, lateral) [m/s2].

        :raises InvalidInput: the command is refused, see the class.
        """
        self._take(values, stamp)

    def control(self, values: Sequence[float], stamp: int | None = None, tick: int = 0) -> None:
        """Store a command (steer, throttle, brake); a `tick` other than 0 replaces its stamp.

        :raises InvalidInput: the command is refused, see the class.
        """
        self._take(values, tick * self._tick_time if tick else stamp)

    def _take(self, values: Sequence[float], stamp: int | None) -> None:
        if stamp in self._idle_ticks or self._again(stamp):
            return
        stamp = self._now if stamp is None else stamp
        oldest = self._now
        if self.real_time:
            oldest = max(self._stamp, self._now - round(COMMAND_SILENCE * 1e9))
        if stamp > self._now:
            self._counts.vehicle_commands_ahead += 1
            self.refuse(
                values,
                f"it answers a tick that has not been: {stamp} ns is ahead of simulated time, {self._now} ns; set "
                "use_sim_time",
            )
        if stamp < oldest:
            self.refuse(values, "it answers an earlier tick")
        if not (form := form_of(values)):
            self.refuse(values, "out of range or not finite")
        self._counts.vehicle_commands += 1
        self._counts.vehicle_commands_surplus += self._fresh  # a second one at this tick
        self._command, self._commanded, self._stamp = Actions(**{form: np.array([values])}), self._now, stamp
        self._fresh, self._given_up = True, False

    def _again(self, stamp: int | None) -> bool:
        """Return whether `stamp` is that of a tick that was published repeatedly and has been answered."""
        repeated, answers = self._repeated
        if stamp != repeated or answers == 0 or (stamp == self._now and not self._fresh):
            return False
        self._repeated = repeated, answers - 1
        return True

    def refuse(self, values: Sequence[float], reason: str) -> NoReturn:
        """Count a rejected command and raise an error with the reason.

        :raises InvalidInput: always, with the reason.
        """
        self._counts.vehicle_commands_refused += 1
        raise InvalidInput(f"{list(values)} at tick {self._now // self._tick_time}: {reason}")

    def _safe_stop(self, state: NDArray[np.void]) -> NDArray[np.void]:
        self._counts.safe_stops += 1
        event = np.zeros(1, EVENT)
        for name in set(EVENT.names or ()) & set(EPISODE.names or ()):
            event[name] = state[name]
        event["kind"] = SAFE_STOP
        return event


def _in_all(command: Actions, rows: int) -> Actions:
    """Return the command to the one vehicle of an episode as actions in all of its rows."""
    if rows == 1:
        return command
    given = {name: getattr(command, name) for name in ("vehicle", "vehicle_control")}
    return Actions(**{name: np.repeat(value, rows, axis=0) for name, value in given.items() if value is not None})
