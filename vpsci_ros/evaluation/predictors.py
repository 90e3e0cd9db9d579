"""Models that predict the next step of a near miss, under one interface: the learned policies, and the controls."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.policy.bank import Bank, situations_of, source_of
from vpsci_ros.policy.choice import ReactionReplay
from vpsci_ros.policy.draws import keys
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.policy.reaction import FADES
from vpsci_ros.policy.stepped import actor_at_work
from vpsci_ros.policy.weights import Weights
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.observation import AGENTS

TRACKED_STEPS = 2  # whose positions give a vehicle's velocity, where published speeds lag behind the positions
Actions = tuple[NDArray[np.float32], NDArray[np.float32]]


class Predictor(Protocol):
    """Interface of models: from observations of N parallel interactions to both agents' accelerations.

    `tracked_steps` is the argument of `scene.scene_at`, which makes the first scene of the closed loop.
    """

    @property
    def tracked_steps(self) -> int:
        """Number of steps by whose positions the vehicle's initial velocity is estimated; 0: the recorded velocity."""

    def begin(self, count: int) -> None:
        """Prepare for `count` interactions with empty histories."""

    def act(
        self,
        vehicle: NDArray[np.float32],
        pedestrian: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        active: NDArray[np.bool_],
    ) -> Actions:
        """Return both agents' accelerations, float32[N, 2] [m/s2], in the vehicle's heading frame of this step.

        :param vehicle, pedestrian: observations float32[N, 6], (6) and (7); curvttc: float64[N] [s].
        :param active: bool[N]; only these rows take a step, the others' answers do not matter.
        """

    def executed(self, actions: Actions, active: NDArray[np.bool_]) -> None:
        """Append the executed accelerations [m/s2] to the histories where `active`."""


class FadingAcceleration:
    """The control in which both agents' last known accelerations continue and fade, as recorded ones do.

    Without a known acceleration an agent keeps its velocity.

    :param fades: by which a step of 0.1 s multiplies the accelerations of vehicle and pedestrian; 1: they are repeated.
    """

    tracked_steps = TRACKED_STEPS

    def __init__(self, fades: tuple[float, float] = (FADES[0], FADES[2])) -> None:
        self._fades = [np.float32(fade) for fade in fades]

    def begin(self, count: int) -> None:
        """Prepare for `count` interactions, see `Predictor.begin`."""
        self._last = [np.zeros((count, 2), np.float32) for _ in AGENTS]

    def act(
        self,
        vehicle: NDArray[np.float32],
        pedestrian: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        active: NDArray[np.bool_],
    ) -> Actions:
        """Return both agents' accelerations, see `Predictor.act`."""
        first, second = (fade * last for fade, last in zip(self._fades, self._last, strict=True))
        return first, second

    def executed(self, actions: Actions, active: NDArray[np.bool_]) -> None:
        """Keep the last accelerations, see `Predictor.executed`."""
        for last, action in zip(self._last, actions, strict=True):
            last[active] = action[active]


class RepeatVelocity(FadingAcceleration):
    """The control: both agents keep the last observed velocity (acceleration 0).

    :param tracked_steps: 0: the recorded velocity; otherwise the vehicle's velocity by its last observed positions.
    """

    def __init__(self, tracked_steps: int = 0) -> None:
        super().__init__((0.0, 0.0))
        self.tracked_steps = tracked_steps


class PolicyPredictor:
    """Both actors of a weights file, run by the nodes' code.

    As in simulation, a history begins where CurvTTC is critical, with the acceleration of the step before.
    """

    tracked_steps = 0  # recorded speeds, as in training

    def __init__(self, weights: Weights) -> None:
        self._weights = weights

    def begin(self, count: int) -> None:
        """Prepare for `count` interactions, see `Predictor.begin`."""
        self._actors = [actor_at_work(self._weights.actor(agent), count) for agent in AGENTS]
        self._begun = np.zeros(count, bool)

    def act(
        self,
        vehicle: NDArray[np.float32],
        pedestrian: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        active: NDArray[np.bool_],
    ) -> Actions:
        """Return both agents' accelerations, see `Predictor.act`."""
        reset = active & ~self._begun & (curvttc < CRITICAL_TTC)
        self._begun |= reset
        acting = active & self._begun
        return (
            self._actors[0].step(vehicle, curvttc, reset, acting),
            self._actors[1].step(pedestrian, curvttc, reset, acting),
        )

    def executed(self, actions: Actions, active: NDArray[np.bool_]) -> None:
        """Append the executed accelerations to the histories, or to what comes before them; `Predictor.executed`."""
        for actor, action in zip(self._actors, actions, strict=True):
            actor.executed(action, active)


def sources_for(bank: Bank, clip: NDArray[np.object_], people: str = "") -> NDArray[np.str_]:
    """Return the bank's source for each interaction, str[N]: the interaction's if the bank has it, else the first.

    :param clip: object[N], "source/clip".
    :param people: one source for all interactions; empty: each its own.
    :raises InvalidInput: the bank does not have the source `people`.
    """
    names = np.array([source_of(name) for name in clip])
    if people:
        bank.of(people)
        return np.full(len(names), people)
    return np.where(np.isin(names, list(bank.reactions)), names, next(iter(bank.reactions)))


class PeoplePredictor:
    """Reactions of a bank, replayed by the nodes' code; both agents keep their velocity until CurvTTC is critical.

    :param clip: object[N], "source/clip" of each interaction, see `sources_for`.
    :param seed: of the draws; row i draws as episode i of scenario 0.
    :param people: the source whose reactions are replayed in all interactions; empty: see `sources_for`.
    :param agents: who acts; the other one is exchanged (`simulators.exchange`), and its choices cost nothing.
    :raises InvalidInput: the bank does not have the source `people`.
    """

    tracked_steps = TRACKED_STEPS

    def __init__(
        self,
        bank: Bank,
        clip: NDArray[np.object_],
        seed: int = 0,
        people: str = "",
        agents: Sequence[str] = AGENTS,
    ) -> None:
        self._people, self._agents = sources_for(bank, clip, people), [AGENTS.index(agent) for agent in agents]
        self._bank, self._seed = bank, seed

    def begin(self, count: int) -> None:
        """Prepare for `count` interactions, see `Predictor.begin`."""
        self._replays = {
            name: [
                (agent, ReactionReplay(self._bank.of(name), agent, count, keeps_lane=False)) for agent in self._agents
            ]
            for name in np.unique(self._people)
        }
        self._key, self._steps = keys(count, self._seed, 0, np.arange(count)), 0
        self._begun = np.zeros(count, bool)
        self._done = np.full((len(AGENTS), count, 2), np.nan)  # accelerations in the last step

    def act(
        self,
        vehicle: NDArray[np.float32],
        pedestrian: NDArray[np.float32],
        curvttc: NDArray[np.float64],
        active: NDArray[np.bool_],
    ) -> Actions:
        """Return both agents' accelerations, see `Predictor.act`."""
        reset = active & ~self._begun & (curvttc < CRITICAL_TTC)
        self._begun |= reset
        situations = situations_of(vehicle, *self._done)
        self._key[:, 4] = self._steps
        self._steps += 1
        out = np.zeros((2, len(active), 2))
        for name, replays in self._replays.items():
            rows = active & self._begun & (self._people == name)
            for agent, replay in replays:
                out[agent] += replay.step(situations, self._key, reset, rows)
        return out[0].astype(np.float32), out[1].astype(np.float32)

    def executed(self, actions: Actions, active: NDArray[np.bool_]) -> None:
        """Append the executed accelerations to the histories, see `Predictor.executed`."""
        for done, action in zip(self._done, actions, strict=True):
            done[active] = action[active]


def predictor_of(policy: Policy, clip: NDArray[np.object_], seed: int = 0) -> Predictor:
    """Return the predictor of a policy; `clip` and `seed` as in `PeoplePredictor`."""
    return PeoplePredictor(policy, clip, seed) if isinstance(policy, Bank) else PolicyPredictor(policy)
