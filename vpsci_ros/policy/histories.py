"""Bookkeeping of histories: one for each episode, from its first hand-over to its end (Algorithm 1).

A history has a step at every policy frame, also while the rule-based pair has control. An agent's action before such a
step is the acceleration that its motion shows. Acting policies and the learner use the same class, so both have
bit-identical histories.
"""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS, STEP, to_heading_frame


class Histories:
    """Step numbers and last motion of the histories of B slots.

    :ivar step: int64[B], policy frames since the first hand-over of the slot's episode.
    :ivar driven: bool[B], where the rule-based pair drove at the last policy frame of the history.
    :ivar done: float32[2, B, 2] [m/s2], accelerations of vehicle and pedestrian since the last policy frame, by their
        motion, as (longitudinal, lateral) in the vehicle's heading frame at that frame.
    """

    def __init__(self, slots: int) -> None:
        self.step = np.full(slots, -1)
        self.driven = np.zeros(slots, np.bool_)
        self.done = np.zeros((len(AGENTS), slots, ACTION_SIZE), np.float32)
        self._begun, self._acted = np.zeros(slots, np.bool_), np.zeros(slots, np.bool_)
        self._episode = np.full((slots, 3), -1)  # scenario, number, frame
        self._motion = np.zeros((slots, 5))  # heading [rad], then east and north [m/s] of vehicle and pedestrian

    def take(
        self, state: NDArray[np.void], on_frame: NDArray[np.bool_], acts: NDArray[np.bool_]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Process a tick; return the slots in which a history begins, and those in which it has a step, bool[B] each.

        :param state: EPISODE[B]; on_frame: bool[B], where policies may act; acts: bool[B], where they do.
        """
        now = np.stack([state[name].astype(np.int64) for name in ("scenario", "episode", "frame")], axis=1)
        other = (now[:, :2] != self._episode[:, :2]).any(axis=1) | (now[:, 2] <= self._episode[:, 2])
        self._begun[other & on_frame] = False
        begins = acts & ~self._begun
        self._begun |= acts
        steps = on_frame & self._begun
        self.driven = steps & ~begins & ~self._acted
        motion = motion_of(state)
        _change(self._motion, motion, self.done)
        self.step[steps] += 1
        self.step[begins] = 0
        self._episode[on_frame], self._acted[on_frame], self._motion[on_frame] = (
            now[on_frame],
            acts[on_frame],
            motion[on_frame],
        )
        return begins, steps


def motion_of(state: NDArray[np.void]) -> NDArray[np.float64]:
    """Return float64[B, 5]: vehicle's heading [rad], then east and north velocity [m/s] of vehicle and pedestrian."""
    out = np.empty((len(state), 5))
    _motion(state, out)
    return out


@kernel
def _motion(state, out):  # type: ignore[no-untyped-def]
    for i in range(state.size):
        slot = state[i]
        heading, speed = slot.vehicle_heading, slot.vehicle_speed
        out[i, 0], out[i, 1], out[i, 2] = heading, speed * np.cos(heading), speed * np.sin(heading)
        out[i, 3], out[i, 4] = slot.pedestrian_vx, slot.pedestrian_vy


@kernel
def _change(before, now, out):  # type: ignore[no-untyped-def]
    for i in range(before.shape[0]):
        for agent in range(out.shape[0]):
            east = (now[i, 1 + 2 * agent] - before[i, 1 + 2 * agent]) / STEP
            north = (now[i, 2 + 2 * agent] - before[i, 2 + 2 * agent]) / STEP
            out[agent, i, 0], out[agent, i, 1] = to_heading_frame(before[i, 0], east, north)
