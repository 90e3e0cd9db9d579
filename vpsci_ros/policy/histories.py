"""Bookkeeping of histories: one for each time that the policies take control (Algorithm 1).

A history begins at a hand-over with nothing but the acceleration with which each agent comes, as its motion shows it,
and ends when control is given back. So a policy has as much of a past in simulation as it has from the onset of a
recording on. Acting policies and the learner use the same class, so both have bit-identical histories.
"""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.observation import ACTION_SIZE, AGENTS, STEP, to_heading_frame


class Histories:
    """Step numbers and last motion of the episodes in B slots.

    :ivar step: int64[B], policy frames since the first hand-over of the slot's episode.
    :ivar done: float32[2, B, 2] [m/s2], accelerations of vehicle and pedestrian since the last policy frame of the
        episode, by their motion, as (longitudinal, lateral) in the vehicle's heading frame at that frame; 0 at the
        episode's first.
    """

    def __init__(self, slots: int) -> None:
        self.step = np.full(slots, -1)
        self.done = np.zeros((len(AGENTS), slots, ACTION_SIZE), np.float32)
        self._begun, self._acted = np.zeros(slots, np.bool_), np.zeros(slots, np.bool_)
        self._episode = np.full((slots, 3), -1)  # scenario, number, frame
        self._motion = np.zeros((slots, 5))  # heading [rad], then east and north [m/s] of vehicle and pedestrian

    def take(
        self, state: NDArray[np.void], on_frame: NDArray[np.bool_], acts: NDArray[np.bool_]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Process a tick; return the slots with a hand-over, and those from the first one on, bool[B] each.

        :param state: EPISODE[B]; on_frame: bool[B], where policies may act; acts: bool[B], where they do.
        """
        now = np.stack([state[name].astype(np.int64) for name in ("scenario", "episode", "frame")], axis=1)
        other = (now[:, :2] != self._episode[:, :2]).any(axis=1) | (now[:, 2] <= self._episode[:, 2])
        new = other & on_frame
        self._begun[new] = self._acted[new] = False
        first, handed_over = acts & ~self._begun, acts & ~self._acted
        self._begun |= acts
        steps = on_frame & self._begun
        motion = motion_of(state)
        _change(self._motion, motion, self.done)
        self.done[:, new] = 0.0
        self.step[steps] += 1
        self.step[first] = 0
        self._episode[on_frame], self._acted[on_frame], self._motion[on_frame] = (
            now[on_frame],
            acts[on_frame],
            motion[on_frame],
        )
        return handed_over, steps


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
