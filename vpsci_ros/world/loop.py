"""The loop over ticks: the world yields a tick, monitor and agents answer, and the world advances.

There are two ways to run it. In one process the loop calls monitor and agents itself (`ticks`, or `step` for a single
tick); in the graph the world's node passes on the answers that came as messages (`advance`). The caller makes a
dataset, an exam, an evaluation or a training from the ticks.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.monitor import assess
from vpsci_ros.world.state import RUNNING
from vpsci_ros.world.tick import NO_ACTIONS, Actions, Assessment, Step, Tick
from vpsci_ros.world.world import World


class Agent(Protocol):
    """An agent that acts for the vehicle or the pedestrian, as `vpsci_ros.policy.agent.PolicyAgent` does."""

    def act(self, tick: Tick, assessment: Assessment) -> NDArray[np.floating[Any]]:
        """Return accelerations [m/s2], float[B, 2], (longitudinal, lateral); used where `assessment.acting`."""


class Loop:
    """A world with its monitor and its agents.

    :param agents: by "vehicle" and "pedestrian"; called at policy frames. The world keeps the lane of a vehicle whose
        agent has a true `keeps_lane`.
    :param always_critical: every running episode counts as critical, so that policy drivers act from its first frame.
    :param intervene: returns the changed actions of a tick, from its EPISODE[B] and its actions, as
        `vpsci_ros.lockstep.intervention.intervened` does; None: no change.
    """

    def __init__(
        self,
        world: World,
        agents: Mapping[str, Agent] | None = None,
        *,
        always_critical: bool = False,
        intervene: Callable[[NDArray[np.void], Actions], Actions] | None = None,
    ) -> None:
        self.world = world
        self.agents = agents or {}
        self._always_critical = always_critical
        self._intervene = intervene
        self._assessed: tuple[Tick, Assessment] | None = None
        if getattr(self.agents.get("vehicle"), "keeps_lane", False):
            self.world.keep_lane()

    def __iter__(self) -> Iterator[Step]:
        """Run the world until its queue of episodes is done, yielding the `Step` of every tick."""
        return self.ticks()

    def ticks(self, given: Callable[[Tick, Assessment], Actions] | None = None) -> Iterator[Step]:
        """Run the world until its queue of episodes is done, yielding the `Step` of every tick.

        :param given: called at each tick, returns actions besides the agents'; None: there are none.
        """
        while not self.world.done:
            yield self.step(NO_ACTIONS if given is None else given(self.world.now, self.assessment))

    @property
    def assessment(self) -> Assessment:
        """The monitor's assessment of the present tick."""
        tick = self.world.now
        if self._assessed is None or self._assessed[0] is not tick:
            curvttc, distance, critical = assess(tick.state)
            if self._always_critical:
                critical = tick.state["status"] == RUNNING
            self._assessed = tick, tick.assessed(curvttc, distance, critical)
        return self._assessed[1]

    def actions(self, given: Actions = NO_ACTIONS) -> Actions:
        """Return the agents' actions at the present tick together with the `given` ones."""
        tick = self.world.now
        if not self.agents or not np.count_nonzero(tick.policy_frame):
            return given
        acted = {name: agent.act(tick, self.assessment) for name, agent in self.agents.items()}
        return replace(given, **{name: action.astype(np.float64) for name, action in acted.items()})

    def step(self, given: Actions = NO_ACTIONS) -> Step:
        """Call monitor and agents, advance by one tick, and return the `Step`."""
        return self.advance(self.assessment, self.actions(given))

    def advance(self, assessment: Assessment, actions: Actions) -> Step:
        """Advance with these answers to the present tick; return the `Step`, with a copy of the tick's state.

        See `World.advance`.
        """
        tick = self.world.now
        state = tick.state.view(np.uint8).copy().view(tick.state.dtype)  # whole, sixty times as fast as by fields
        if self._intervene is not None:
            actions = self._intervene(tick.state, actions)
        events = self.world.advance(assessment, actions)
        return Step(tick=tick._replace(state=state), assessment=assessment, actions=actions, events=events)
