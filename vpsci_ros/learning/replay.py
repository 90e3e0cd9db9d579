"""Replay buffers: histories as they happened, and mini-batches of whole histories drawn from them.

Algorithm 1 draws samples k and sums their losses over t. A sample here is a history, since an SST network at step t
needs all that came before; histories are drawn until they hold `batch_size` steps, the "samples per training
iteration" of Table 8, so that an update costs the same whatever the length of the episodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS, OBSERVATION_SIZE

Floats = NDArray[np.float32]


@dataclass
class History:
    """T steps of both agents from the first step of a history on, by agent where the two differ.

    `observation` and `curvttc` include what followed the last action. `next_velocity` are the next speeds that rewards
    (14)-(15) compare with: recorded ones in real experience, the frozen stage-1 actor's in simulated.
    """

    observation: dict[str, Floats]  # [T + 1, 6]
    curvttc: Floats  # [T + 1] [s]
    action: dict[str, Floats]  # [T, 2] [m/s2] as executed
    next_velocity: dict[str, Floats]  # [T, 2] [m/s]
    events: dict[str, Floats]  # [T, 2] collision and goal, unweighted rewards (25)-(26)
    terminal: bool  # the episode ended with the last step
    real: bool  # recorded, not simulated
    priority: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))  # [T] |delta|

    def __len__(self) -> int:
        return len(self.curvttc) - 1


@dataclass(frozen=True)
class Batch:
    """M histories as padded tensors; fields as in `History` with leading M, and present bool[M, T]."""

    observation: dict[str, Tensor]
    curvttc: Tensor
    action: dict[str, Tensor]
    next_velocity: dict[str, Tensor]
    events: dict[str, Tensor]
    terminal: Tensor  # bool[M, T]: nothing follows this step
    real: Tensor  # bool[M]
    present: Tensor


def collate(histories: Sequence[History]) -> Batch:
    """Pad histories to the longest of them."""
    steps = max(len(h) for h in histories)
    lengths = np.array([len(h) for h in histories])
    present = np.arange(steps) < lengths[:, None]
    terminal = np.zeros_like(present)
    terminal[np.arange(len(histories)), lengths - 1] = [h.terminal for h in histories]

    def stacked(name: str, agent: str, width: int, extra: int) -> Tensor:
        out = np.zeros((len(histories), steps + extra, width), np.float32)
        for row, history in zip(out, histories, strict=True):
            values = getattr(history, name)[agent]
            row[: len(values)] = values
        return torch.from_numpy(out)

    curvttc = np.full((len(histories), steps + 1), np.inf, np.float32)
    for row, history in zip(curvttc, histories, strict=True):
        row[: len(history) + 1] = history.curvttc
    return Batch(
        observation={agent: stacked("observation", agent, OBSERVATION_SIZE, 1) for agent in AGENTS},
        curvttc=torch.from_numpy(curvttc),
        action={agent: stacked("action", agent, ACTION_SIZE, 0) for agent in AGENTS},
        next_velocity={agent: stacked("next_velocity", agent, ACTION_SIZE, 0) for agent in AGENTS},
        events={agent: stacked("events", agent, ACTION_SIZE, 0) for agent in AGENTS},
        terminal=torch.from_numpy(terminal),
        real=torch.tensor([h.real for h in histories]),
        present=torch.from_numpy(present),
    )


def recorded_histories(interactions: Interactions) -> list[History]:
    """Return the real experience that interactions hold: the last recorded step is what followed the last action.

    The record's end ends the episode for the learner, so returns are sums over what was recorded.
    """
    histories = []
    for i, length in enumerate(interactions.length):
        steps = int(length) - 1
        histories.append(
            History(
                observation={a: interactions.observation[a][i, : steps + 1] for a in AGENTS},
                curvttc=interactions.curvttc[i, : steps + 1].astype(np.float32),
                action={a: interactions.action[a][i, :steps] for a in AGENTS},
                next_velocity={a: interactions.next_velocity[a][i, :steps] for a in AGENTS},
                events={a: np.zeros((steps, 2), np.float32) for a in AGENTS},
                terminal=True,
                real=True,
            )
        )
    return histories


def up_to_capacity(histories: list[History], capacity: int, rng: np.random.Generator) -> list[int]:
    """Return the indices of as many histories, in random order, as `capacity` steps hold; at least one."""
    order = rng.permutation(len(histories))
    filled = np.cumsum([len(histories[i]) for i in order])
    return [int(i) for i in order[: max(1, int(np.searchsorted(filled, capacity, side="right")))]]


class ReplayBuffer:
    """The simulation replay buffer B_s: simulated histories, and a share of real ones that is never overwritten.

    Steps are drawn with the probabilities of (17) and each brings the whole history that it belongs to.

    :param capacity: steps held; the oldest simulated histories make room.
    :param real: real experience, kept for good; its steps count.
    :param exponent, real_bonus: alpha and beta of (17).
    """

    def __init__(self, capacity: int, real: list[History], exponent: float, real_bonus: float) -> None:
        self.histories: list[History] = []
        self._capacity, self._exponent, self._bonus = capacity, exponent, real_bonus
        self.highest = 1.0
        self.steps = 0
        for history in real:
            self.append(history)

    def append(self, history: History) -> None:
        """Add a history; its steps get the highest priority so far, so that each is likely to be seen once."""
        if len(history.priority) == 0:
            history.priority = np.full(len(history), self.highest)
        self.histories.append(history)
        self.steps += len(history)
        while self.steps > self._capacity:
            oldest = next((i for i, h in enumerate(self.histories) if not h.real), None)
            if oldest is None or self.histories[oldest] is history:
                break
            self.steps -= len(self.histories.pop(oldest))

    def restore(self, histories: list[History], highest: float) -> None:
        """Hold `histories`, with their priorities, instead."""
        self.histories, self.highest, self.steps = histories, highest, sum(map(len, histories))

    def draw(self, steps: int, rng: np.random.Generator) -> list[History]:
        """Draw distinct histories by (17) until they hold `steps` steps, in four times as many tries at most.

        Fewer come out where few histories hold nearly all of the weight.
        """
        owner = np.repeat(np.arange(len(self.histories)), [len(h) for h in self.histories])
        delta = np.concatenate([h.priority for h in self.histories])
        real = np.repeat([h.real for h in self.histories], [len(h) for h in self.histories])
        weight = delta**self._exponent + self._bonus * real
        total = weight.sum()
        p = weight / total if total > 0 else np.full(len(weight), 1.0 / len(weight))
        picked: list[History] = []
        taken: set[int] = set()
        held = 0
        for i in owner[rng.choice(len(p), size=4 * steps, p=p)]:
            if held >= steps:
                break
            if i not in taken:
                taken.add(int(i))
                picked.append(self.histories[i])
                held += len(self.histories[i])
        return picked

    def reprioritise(self, histories: list[History], errors: NDArray[np.float64]) -> None:
        """Store |delta|, float64[M, T], of the histories of a batch."""
        for history, error in zip(histories, errors, strict=True):
            history.priority = error[: len(history)].copy()
            self.highest = max(self.highest, float(history.priority.max()))
