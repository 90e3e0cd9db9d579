"""The policy frames since the hand-overs of the present episodes, for a policy that is started again on the way.

A policy's answer is a function of all policy frames since the hand-over, which its process carries as hidden state. A
new process works through the frames that the world has kept for it, and then answers as the old one would have, to
the bit.
"""

import math
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Header

from vpsci_msgs.msg import SafetyState, WorldState
from vpsci_msgs.srv import History
from vpsci_ros.errors import InvalidInput
from vpsci_ros.nodes import convert
from vpsci_ros.wire.layout import MAP, sequences
from vpsci_ros.wire.signature import is_signed, require_signature, signature
from vpsci_ros.world import EPISODE, RUNNING, WorldConfig
from vpsci_ros.world.tick import Assessment, Tick

_WHOLE = np.dtype((np.void, EPISODE.itemsize))


class _Frame(NamedTuple):
    """A policy frame, with the episodes in which a policy acted at it."""

    tick: int  # its number
    slots: NDArray[np.int64]  # [n]
    state: NDArray[np.void]  # EPISODE[n]
    curvttc: NDArray[np.float64]  # [n] [s]
    critical: NDArray[np.bool_]  # [n]


class FrameHistory:
    """The policy frames of the running episodes in which a policy has acted, for the longest time of an episode."""

    def __init__(self, config: WorldConfig, batch: int) -> None:
        self._most = config.pedestrians
        self._rows = batch * self._most
        self._period = config.tick
        longest = math.ceil(config.episode_time / config.tick) // config.policy_ticks + 2
        self._frames: deque[_Frame] = deque(maxlen=longest)

    def note(self, tick: Tick, assessment: Assessment) -> None:
        """Keep the episodes in which the policies act at this tick, with all of their pedestrians."""
        if assessment.answered and np.count_nonzero(assessment.acting):
            acts = assessment.acting.reshape(-1, self._most).any(axis=1)
            slots = np.flatnonzero(np.repeat(acts, self._most))
            self._frames.append(
                _Frame(
                    tick=tick.number,
                    slots=slots,
                    state=tick.state.view(_WHOLE)[slots].view(EPISODE),  # forty times as fast as by fields
                    curvttc=assessment.curvttc[slots],
                    critical=assessment.critical[slots],
                )
            )

    def clear(self) -> None:
        """Forget everything: other episodes begin."""
        self._frames.clear()

    def since(self, tick: int, present: NDArray[np.void]) -> tuple[list[WorldState], list[SafetyState]]:
        """Return the frames after `tick`, with the episodes that still run in EPISODE[B] `present`, as messages."""
        states, safeties = [], []
        for frame in self._frames:
            now = present[frame.slots]
            same = (now["scenario"] == frame.state["scenario"]) & (now["episode"] == frame.state["episode"])
            same &= now["status"] == RUNNING
            if frame.tick > tick and same.any():
                state, safety = self._messages(frame, same)
                states.append(state)
                safeties.append(safety)
        return states, safeties

    def _messages(self, frame: _Frame, same: NDArray[np.bool_]) -> tuple[WorldState, SafetyState]:
        slots = frame.slots[same]
        state = np.zeros(self._rows, EPISODE)
        curvttc, critical = np.full(self._rows, np.inf), np.zeros(self._rows, bool)
        policy_frame = np.zeros(self._rows, bool)
        state[slots], curvttc[slots], critical[slots] = frame.state[same], frame.curvttc[same], frame.critical[same]
        policy_frame[slots] = frame.state[same]["status"] == RUNNING
        message = convert.world_state_message(state, policy_frame, frame.tick, self._period)
        header = Header(stamp=message.header.stamp, frame_id=MAP)
        distance = np.zeros(self._rows)  # no policy reads it
        return message, convert.safety_message(header, frame.tick, curvttc, distance, critical)


def sealed(request: History.Request, response: History.Response) -> History.Response:
    """Return a reply whose last frame, an empty one, holds its signature, where the run has a secret."""
    if is_signed():
        content = _content(request, response.running, response.tick, _pairs(response))
        seal = Header(frame_id=signature(request.after_tick, content))
        response.states = [*response.states, WorldState(header=seal)]
        response.safeties = [*response.safeties, SafetyState()]
    return response


def frames_of(request: History.Request, response: History.Response) -> list[tuple[WorldState, SafetyState]]:
    """Return the frames of a reply.

    :raises InvalidInput: states and answers to them differ in number, or the world of this run did not sign it for
        this request.
    """
    if len(response.states) != len(response.safeties):
        raise InvalidInput(
            f"/world/history: expected as many states as answers of the monitor, got {len(response.states)} and "
            f"{len(response.safeties)}; does another program offer it?"
        )
    pairs = _pairs(response)
    if not is_signed():
        return pairs
    frames, seal = pairs[:-1], pairs[-1][0].header.frame_id if pairs else ""
    content = _content(request, response.running, response.tick, frames)
    require_signature(seal, request.after_tick, content, "/world/history")
    return frames


def _pairs(response: History.Response) -> list[tuple[WorldState, SafetyState]]:
    return list(zip(response.states, response.safeties, strict=True))


def _content(request: History.Request, running: bool, tick: int, frames: list[tuple[WorldState, SafetyState]]) -> bytes:
    """Return what a signature is made of: the challenge, and all that a policy reads of a reply, part by part."""
    parts = [part for pair in frames for message in pair for part in _parts(message)]
    return b"/world/history %d %d %d " % (request.challenge, running, tick) + b"".join(
        b"%d " % len(part) + part for part in parts
    )


def _parts(message: Any) -> Iterator[bytes]:
    stamp = message.header.stamp
    yield b"%d %d %d" % (message.tick, stamp.sec, stamp.nanosec)
    for name in sequences(type(message).__name__):
        yield memoryview(getattr(message, name)).tobytes()
