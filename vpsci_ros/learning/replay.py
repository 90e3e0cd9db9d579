"""The replay buffers of both stages, and mini-batches drawn from a buffer.

Stage 1 draws single recorded steps, each with its history of `WINDOW` steps (Table 8's input sequence length). Stage 2
draws steps by (17), and each brings its whole history, since an SST network at step t needs all that came before;
histories are drawn until they hold `batch_size` steps, so that an update costs about the same whatever their length.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vpsci_ros.data.interactions import Interactions
from vpsci_ros.evaluation.scene import Scene, scene_at
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS, OBSERVATION_SIZE
from vpsci_ros.world.road import LANE_POINTS

WINDOW = 10  # steps of the history of a recorded step, this one included (Table 8)
Floats = NDArray[np.float32]


@dataclass
class History:
    """A history of T steps of both agents: from a hand-over to the hand-back, or a recording from its onset on.

    `observation` and `curvttc` include the step after the last action. `next_velocity` has the next speeds that rewards
    (14)-(15) compare with: in real experience the recorded ones, in simulated experience the frozen stage-1 actor's.
    `lane`, `way`, `wanted` and `rules` are those of `world.road.Road`; recordings have none, and zeros here.
    """

    observation: dict[str, Floats]  # [T + 1, 6]
    curvttc: Floats  # [T + 1] [s]
    came: dict[str, Floats]  # [T, 2] [m/s2] by the motion since the step before
    action: dict[str, Floats]  # [T, 2] [m/s2] as executed
    next_velocity: dict[str, Floats]  # [T, 2] [m/s]
    events: dict[str, Floats]  # [T, 2] collision and goal, unweighted rewards (25)-(26)
    terminal: bool  # no return follows the last step; false after a timeout
    real: bool  # recorded, not simulated
    lane: Floats  # [T, 2 LANE_POINTS] [m]
    way: Floats  # [T, 2]
    wanted: Floats  # [2] [m/s]
    rules: Floats  # [4] release time [s], the pedestrian's gain; 1 or 0: the world keeps the lane, and limits jerk
    priority: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))  # [T] |delta|
    near: float = 1.0  # [m] how far roll-outs from it last came below the margin, see `closed_loop`

    def __len__(self) -> int:
        return len(self.curvttc) - 1


@dataclass(frozen=True)
class Batch:
    """A batch of M histories as padded tensors; each field is that of `History` with a leading dimension M.

    :ivar came: by agent float32[M, 2] [m/s2], with which they come to the first step.
    :ivar present: bool[M, T], steps that are trained on.
    :ivar length: int64[M], steps of each history.
    :ivar scene: of recorded steps, M scenes in which the last action is taken; None: histories are whole.
    """

    observation: dict[str, Tensor]
    curvttc: Tensor
    came: dict[str, Tensor]
    action: dict[str, Tensor]
    next_velocity: dict[str, Tensor]
    events: dict[str, Tensor]
    terminal: Tensor  # bool[M]
    real: Tensor  # bool[M]
    present: Tensor
    length: Tensor
    scene: Scene | None = None

    @property
    def step(self) -> Tensor | None:
        """For recorded steps, the trained step of each row, int64[M]; None: all steps of a history are trained on."""
        return None if self.scene is None else self.length - 1


def collate(histories: Sequence[History]) -> Batch:
    """Return histories as a batch, padded to the longest history."""
    steps = max(len(h) for h in histories)

    def stacked(name: str, agent: str, width: int, extra: int) -> Tensor:
        out = np.zeros((len(histories), steps + extra, width), np.float32)
        for row, history in zip(out, histories, strict=True):
            values = getattr(history, name)[agent]
            row[: len(values)] = values
        return torch.from_numpy(out)

    curvttc = np.full((len(histories), steps + 1), np.inf, np.float32)
    present = np.zeros((len(histories), steps), np.bool_)
    for i, history in enumerate(histories):
        curvttc[i, : len(history) + 1] = history.curvttc
        present[i, : len(history)] = True
    return Batch(
        observation={agent: stacked("observation", agent, OBSERVATION_SIZE, 1) for agent in AGENTS},
        curvttc=torch.from_numpy(curvttc),
        came={agent: torch.from_numpy(np.stack([h.came[agent][0] for h in histories])) for agent in AGENTS},
        action={agent: stacked("action", agent, ACTION_SIZE, 0) for agent in AGENTS},
        next_velocity={agent: stacked("next_velocity", agent, ACTION_SIZE, 0) for agent in AGENTS},
        events={agent: stacked("events", agent, ACTION_SIZE, 0) for agent in AGENTS},
        terminal=torch.tensor([h.terminal for h in histories]),
        real=torch.tensor([h.real for h in histories]),
        present=torch.from_numpy(present),
        length=torch.tensor([len(h) for h in histories]),
    )


def recorded_steps(interactions: Interactions, row: NDArray[np.int64], at: NDArray[np.int64]) -> Batch:
    """Return the steps `at` of the interactions `row`, int64[M] each, with histories of up to `WINDOW` steps.

    The step after the last one is as recorded. The record's end ends the episode, so returns are sums over the record.
    """
    begin = np.maximum(at - WINDOW + 1, 0)
    length, rows, index = at - begin + 1, row[:, None], begin[:, None] + np.arange(WINDOW + 1)
    known = index <= at[:, None] + 1
    index = np.minimum(index, interactions.motion.shape[1] - 1)

    def cut(values: NDArray[Any], steps: int, least: float = 0.0) -> Tensor:
        own = values[rows, index[:, :steps]].astype(np.float32)
        inside = known[:, :steps].reshape(*known[:, :steps].shape, *[1] * (own.ndim - 2))
        return torch.from_numpy(np.where(inside, own, np.float32(least)))

    present = np.arange(WINDOW) == length[:, None] - 1
    return Batch(
        observation={agent: cut(interactions.observation[agent], WINDOW + 1) for agent in AGENTS},
        curvttc=cut(interactions.curvttc, WINDOW + 1, np.inf),
        came={agent: torch.from_numpy(values) for agent, values in interactions.came_to(row, begin).items()},
        action={agent: cut(interactions.action[agent], WINDOW) for agent in AGENTS},
        next_velocity={agent: cut(interactions.next_velocity[agent], WINDOW) for agent in AGENTS},
        events={agent: torch.zeros(len(row), WINDOW, 2) for agent in AGENTS},
        terminal=torch.from_numpy(at + 2 == interactions.length[row]),
        real=torch.ones(len(row), dtype=torch.bool),
        present=torch.from_numpy(present),
        length=torch.from_numpy(length),
        scene=scene_at(torch.from_numpy(interactions.motion[row]), torch.from_numpy(at)),
    )


def draw_recorded(interactions: Interactions, steps: int, rng: np.random.Generator) -> Batch:
    """Return `steps` recorded steps as a batch, drawn uniformly with replacement from those whose actions are known."""
    row, at = np.nonzero(interactions.acted)
    picked = rng.integers(len(row), size=steps)
    return recorded_steps(interactions, row[picked], at[picked])


def recorded_histories(interactions: Interactions) -> list[History]:
    """Return recorded interactions from their onsets on, one history each; the last step follows the last action."""
    histories = []
    for i, (first, length) in enumerate(zip(interactions.first, interactions.length, strict=True)):
        begin, end = int(first), int(length) - 1
        if begin >= end:
            continue
        steps = end - begin
        came = {a: np.concatenate([np.zeros((1, 2), np.float32), interactions.action[a][i, :end]]) for a in AGENTS}
        histories.append(
            History(
                observation={a: interactions.observation[a][i, begin : end + 1] for a in AGENTS},
                curvttc=interactions.curvttc[i, begin : end + 1].astype(np.float32),
                came={a: values[begin:end] for a, values in came.items()},
                action={a: interactions.action[a][i, begin:end] for a in AGENTS},
                next_velocity={a: interactions.next_velocity[a][i, begin:end] for a in AGENTS},
                events={a: np.zeros((steps, 2), np.float32) for a in AGENTS},
                terminal=True,
                real=True,
                lane=np.zeros((steps, 2 * LANE_POINTS), np.float32),
                way=np.zeros((steps, 2), np.float32),
                wanted=np.zeros(2, np.float32),
                rules=np.zeros(4, np.float32),
            )
        )
    return histories


def up_to_capacity(histories: list[History], capacity: int, rng: np.random.Generator) -> list[int]:
    """Return the indices of random histories with at most `capacity` steps in total; at least one history."""
    order = rng.permutation(len(histories))
    filled = np.cumsum([len(histories[i]) for i in order])
    return [int(i) for i in order[: max(1, int(np.searchsorted(filled, capacity, side="right")))]]


class ReplayBuffer:
    """The simulation replay buffer B_s: simulated histories, and a share of real ones that is never overwritten.

    Its steps are drawn with the probabilities of (17).

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
        """Add a history; its steps get the highest priority so far, so that each step is likely to be drawn once."""
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
        """Replace the content by `histories`, with their priorities."""
        self.histories, self.highest = histories, highest
        self.steps = sum(map(len, histories))

    def draw(self, steps: int, rng: np.random.Generator) -> list[History]:
        """Draw distinct histories by (17) until they have so many steps, in at most 4 times `steps` tries.

        Fewer steps are returned where few histories have nearly all of the weight.
        """
        lengths = [len(h) for h in self.histories]
        owner = np.repeat(np.arange(len(self.histories)), lengths)
        delta = np.concatenate([h.priority for h in self.histories])
        real = np.repeat([h.real for h in self.histories], lengths)
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

    @property
    def simulated(self) -> list[History]:
        """The simulated histories, oldest first."""
        return [history for history in self.histories if not history.real]

    def reprioritise(self, histories: list[History], errors: NDArray[np.float64]) -> None:
        """Store |delta|, float64[M, T], as the priorities of a batch's histories."""
        for history, error in zip(histories, errors, strict=True):
            history.priority = error[: len(history)].copy()
            self.highest = max(self.highest, float(history.priority.max()))
