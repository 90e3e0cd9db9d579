"""Who drives: the rule-based pair until it is critical, then both policies, and back when the danger is over.

The policies are asked at policy frames only, every `policy_period` since the spawn, and their answers hold in
between. They take both agents at the first policy frame that is critical. Each critical tick sets `hold` to
`release_time`, each other tick counts it down, and control is given back at the first policy frame that is not
critical and has no hold left. So neither a flicker of CurvTTC nor a critical tick between two policy frames moves
control to and fro.

The danger is over when the two have passed each other, not when one of them has begun to give way: then the rule-based
pair, which knows nothing of it, would take up its speed and its way into the same conflict, with less room than before.
With the shipped policies 58% of the critical episodes have to be handed over again after a release time of 1 s, 16%
after 2 s, 1% after 3 s. Then the autopilot still stops for somebody whom the policy would have passed behind at 2 m/s,
and is late: both goals are reached in 69% after 3 s, 79% after 4 s and 82% after the 5 s of the default
(`python test/benchmarks/outcomes.py --release-time 3`).
"""

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.config import WorldConfig
from vpsci_ros.world.state import HANDED_BACK, HANDED_OVER, RUNNING


def policy_frame(state: NDArray[np.void], config: WorldConfig) -> NDArray[np.bool_]:
    """Return where the policies are asked: bool[B] for EPISODE[B] records."""
    return (state["status"] == RUNNING) & (state["frame"] % config.policy_ticks == 0)


def acting(
    state: NDArray[np.void], asked: NDArray[np.bool_], critical: NDArray[np.bool_] | NDArray[np.uint8]
) -> NDArray[np.bool_]:
    """Return in which episodes the policies act now, bool[B].

    A history begins where `acting & (state["controlled"] == 0)`.

    :param state: EPISODE[B]; `status`, `controlled` and `hold` are read.
    :param asked: bool[B], `policy_frame` of the same tick.
    :param critical: bool[B] or uint8[B], from the safety monitor, of the same tick.
    """
    kept = (state["controlled"] != 0) & (state["hold"] > 0)
    return asked & (state["status"] == RUNNING) & ((critical != 0) | kept)


@kernel
def update(episode, critical, asked, acts, release_ticks):  # type: ignore[no-untyped-def]
    """Take one running EPISODE record through the decisions of one tick; return the kind of event, or 0."""
    kind = 0
    if asked:
        if acts and episode.controlled == 0:
            kind = HANDED_OVER
        elif not acts and episode.controlled != 0:
            kind = HANDED_BACK
        episode.controlled = acts
        if not acts:
            episode.step = 0
            episode.vehicle_held = 0
            episode.pedestrian_held = 0
    if critical:
        episode.hold = release_ticks
    elif episode.hold > 0:
        episode.hold -= 1
    return kind
