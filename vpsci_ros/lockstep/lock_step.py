"""Lock-step: the answers to the present tick, and whether the world may advance."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.lockstep.counts import WorldCounts
from vpsci_ros.lockstep.external_driver import ExternalDriver
from vpsci_ros.lockstep.simulator_config import SimulatorConfig
from vpsci_ros.world.observation import AGENTS
from vpsci_ros.world.state import NO_EVENTS, RUNNING
from vpsci_ros.world.tick import Actions, Assessment, Floats, Tick, finite_pairs
from vpsci_ros.world.world_config import WorldConfig

T = TypeVar("T", bound=Assessment | Floats)
REMEMBERED = 16  # ticks for which a first answer is kept, to compare with later ones
SAFETY = "safety"  # the monitor among those who answer
FIRST_ANSWER = 10.0  # [s] for monitor and policies, whose readers may be matched seconds after the world's
REPLAY_WINDOW = 512  # transitions by which the learner may be behind before the world waits: some episodes


class LockStep:
    """Collects the answers to a tick; late answers are ignored, and refused answers count as missing.

    The first answer of a respondent stands. A later answer that differs is refused and counted, also when the world has
    moved on meanwhile: then a second program answers on the same topic, and which of them comes first is chance. An
    answer to a tick that is still to come is refused and counted, too: the monitor and the policies answer only ticks
    that the world has published, so such an answer is another program's, or rests on another program's state.

    The world moves on when all have answered, or `action_timeout` is over; at the first tick monitor and policies have
    `FIRST_ANSWER` at least, since a lost announcement of the middleware is repeated after 3 s, and none of them answers
    before everybody reads it. It does not move on while it is paused, unless a step was requested; nor before the tick
    is due, where the wall clock sets the pace; nor while the learner is too far behind. `now` is a time of a monotonic
    clock [s].

    :param counts: where refused answers and late ticks are counted.
    :param external: holds the commands of an external driving system; None: another driver drives the vehicle.
    :ivar policies: agents that policies drive.
    :ivar tick: the present tick; None before the first.
    :ivar assessment, actions: the answers of monitor and agents to the present tick.
    :ivar versions: agent -> version of the policy that answered.
    :ivar unread: number of transitions that the learner has not read yet.
    """

    def __init__(
        self, config: SimulatorConfig, world: WorldConfig, counts: WorldCounts, external: ExternalDriver | None = None
    ) -> None:
        self.config = config
        self.external = external
        self.policies = [agent for agent in AGENTS if getattr(world, f"{agent}_driver") == "policy"]
        self.walkers = ["pedestrian"] if world.pedestrian_driver == "external" else []
        self._counts = counts
        self.tick: Tick | None = None
        self.assessment: Assessment | None = None
        self._accelerations: dict[str, Floats] = {}  # of those who have answered
        self.versions: dict[str, int] = {}
        self.unread = 0
        self.paused = False
        self._running = False  # some episode is
        self._wanted: set[str] = set()
        self._answered: set[str] = set()
        self._taken: dict[int, dict[str, Any]] = {}  # tick -> sender -> answer, of the last ticks in their order
        self._over = False
        self._first = True  # so is the present tick
        self._step = False  # one is to be taken while paused
        self._paced = False
        self._due = True  # false: by the wall clock, the next tick is still to come
        self._since = 0.0  # [s] when the tick began

    # ---- a tick and its answers

    def begin(self, tick: Tick, now: float) -> None:
        """Clear the last tick's answers and accept those to `tick`."""
        self._first = self.tick is None
        self.tick, self._since = tick, now
        self.assessment = None
        self._accelerations.clear()
        self._running = RUNNING in tick.state["status"].tobytes()  # to compare takes 3 us
        policies = self.policies if np.count_nonzero(tick.policy_frame) else []
        self._wanted = {SAFETY, *policies, *(self.walkers if self._running else ())}
        self._answered.clear()
        while self._taken and (oldest := next(iter(self._taken))) <= tick.number - REMEMBERED:
            del self._taken[oldest]
        self.versions.clear()
        self._step, self._due = False, not self._paced
        if self.external:
            self.external.begin(tick, running=self._running)

    def end(self) -> None:
        """Accept no further answers after the last tick."""
        self._over = True

    @property
    def running(self) -> bool:
        """Whether a first tick has begun and the last one has not ended."""
        return self.tick is not None and not self._over

    def take_assessment(self, number: int, read: Callable[[Tick], Assessment]) -> None:
        """Store the monitor's answer to the tick of this number.

        :raises InvalidInput: `read` does, the answer contradicts the first one, or the tick is still to come; the
            answer is refused.
        """
        assessment = self._read(SAFETY, number, read)
        if assessment is not None:
            self.assessment = assessment

    def take_action(self, number: int, agent: str, version: int, read: Callable[[Tick], Floats]) -> None:
        """Store an agent's answer, accelerations float64[B, 2] [m/s2], to the tick of this number.

        :raises InvalidInput: `read` does, an acceleration is not finite, the answer contradicts the first one, or the
            tick is still to come; the answer is refused.
        """
        answer = self._read(agent, number, lambda tick: finite_pairs(agent, read(tick)))
        if answer is not None:
            self._accelerations[agent], self.versions[agent] = answer, version

    @property
    def actions(self) -> Actions:
        """The agents' answers to the present tick."""
        return Actions(**self._accelerations)

    def early_command(self) -> None:
        """Count a command that came before the first tick."""
        self._counts.vehicle_commands_early += 1

    def answers(self) -> tuple[Assessment, Actions, NDArray[np.void]]:
        """Return the stored answers to the present tick, and the events of the external driver, EVENT[n]."""
        assert self.tick is not None, "answers() before begin()"
        assessment = self.tick.unassessed() if self.assessment is None else self.assessment
        if self.external is None:
            return assessment, self.actions, NO_EVENTS
        command, events = self.external.drive(self.tick.state)
        return assessment, replace(command, pedestrian=self.actions.pedestrian), events

    def _read(self, sender: str, number: int, read: Callable[[Tick], T]) -> T | None:
        if self._over:
            return None
        if self.tick is None:
            self._require_over(sender, number, -1)
            return None
        first = self._taken.get(number, {}).get(sender)
        if number == self.tick.number:
            self._answered.add(sender)
        elif first is None:
            self._require_over(sender, number, self.tick.number)
            return None
        try:
            answer = read(self.tick)
        except InvalidInput:
            self._counts.add_fault(sender, "refused")
            raise
        if first is None:
            self._taken.setdefault(number, {})[sender] = answer
            return answer
        if not _same(first, answer):
            self._counts.add_fault(sender, "contradicted")
            raise InvalidInput(f"expected one answer to tick {number}, got another that differs; the first stands")
        return None

    def _require_over(self, sender: str, number: int, now: int) -> None:
        """Refuse an answer to a tick that is still to come.

        :raises InvalidInput: `number` is above `now`, the number of the present tick.
        """
        if number > now:
            self._counts.add_fault(sender, "early")
            raise InvalidInput(f"expected no answer to tick {number} yet, which is still to come; got one")

    # ---- may it go on?

    def may_advance(self, now: float | None = None) -> bool:
        """Return whether the world may advance; without `now` [s], a missing answer is waited for without limit."""
        if not self.running or not self._due or (self.paused and not self._step) or self.behind:
            return False
        return not self.unanswered or (now is not None and now - self._since > self._patience)

    @property
    def _patience(self) -> float:
        own = {SAFETY, *self.policies} & self.unanswered
        return max(self.config.action_timeout, FIRST_ANSWER if self._first and own else 0.0)

    @property
    def unanswered(self) -> set[str]:
        """Respondents without an answer to the tick: "safety", "vehicle", "pedestrian"."""
        external = self.external and self._running and not self.external.answered
        return (self._wanted - self._answered) | ({"vehicle"} if external else set())

    @property
    def behind(self) -> bool:
        """Whether the world has to wait until the learner has read more transitions."""
        return self.unread >= REPLAY_WINDOW

    def pause(self, paused: bool, now: float) -> None:
        """Pause or resume the world; a pause makes no answer late."""
        self.paused, self._step, self._since = paused, False, now

    def step(self, now: float) -> bool:
        """Let the paused world advance by one tick; return whether that is possible."""
        if self.paused and self.running:
            self._step, self._due, self._since = True, True, now
        return self._step

    def pace(self, paced: bool) -> None:
        """Choose whether the world advances only at each `beat`, or as soon as possible."""
        self._paced, self._due = paced, True

    def beat(self) -> None:
        """Mark the next tick as due by the wall clock."""
        if self.running and not self.paused:
            self._counts.late_ticks += self._due  # the last one is not over yet
            self._due = True


def _same(first: Assessment | Floats, second: Assessment | Floats) -> bool:
    """Return whether two answers say the same to the bit."""
    answers = first, second
    one, other = ((each.curvttc, each.critical) if isinstance(each, Assessment) else (each,) for each in answers)
    return all(map(np.array_equal, one, other))
