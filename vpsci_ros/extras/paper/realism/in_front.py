"""One agent in front of another one that is not its own: the recorded one, or one that does the same at every onset.

`front` puts the acting agent before the recording of the other one, as a driving system or a walker from elsewhere
would come. `answers` exchanges the other one from the onset on, so that only the acting agent's answer differs between
two exchanges. `recorded_answers` sorts recordings by what the other one then did. That is no experiment: drivers brake
for pedestrians who walk on, and who waits lets the car go.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.evaluation.onsets import Onsets, Other
from vpsci_ros.evaluation.simulators import Simulator, tracked
from vpsci_ros.extras.paper.realism.motion import with_onset
from vpsci_ros.extras.paper.realism.order import Scores, scores
from vpsci_ros.world.observation import AGENTS, STEP

EXCHANGES = {
    "pedestrian": {"keeps_speed": 0.0, "brakes": -3.0, "accelerates": 2.0, "stands": -math.inf},  # what the car does
    "vehicle": {"walks_on": 0.0, "stands": -math.inf},  # what the pedestrian does
}
"""Acting agent -> what the other one does -> its acceleration [m/s2], see `onsets.Other`."""
COMPARED = {"pedestrian": ("keeps_speed", "brakes"), "vehicle": ("walks_on", "stands")}  # first less second
SLOWER = 0.8  # of the speed at the onset; below it an agent is slower by a fifth
LAST = 5  # steps whose mean speed is that after 3 s
DECIDED = 15  # steps after which a recording is sorted by what the other one did
KEEPS, BRAKES, STANDS = 0.3, -1.0, 0.3  # [m/s2], [m/s2], [m/s]

Floats = NDArray[np.float64]
Answer = dict[str, Floats]
"""`slower`, the share that is slower by a fifth after 3 s, and `change` of speed [m/s], float64[n] each."""


def front(onsets: Onsets, simulate: Simulator, agent: str) -> Scores:
    """Return the scores of an agent that a simulator moves in front of the other one's recording, float64[n] each.

    The energy score is that of the acting agent alone. Besides those of `Scores`, `off` [m] is the mean distance of the
    other agent, as the simulator moved it by the recorded accelerations, from its recording; a simulator that sees no
    movement of the other agent does not follow the recording. The scores take the recorded positions.

    :param agent: the acting one, "vehicle" or "pedestrian".
    """
    other = 1 - AGENTS.index(agent)
    positions = simulate(replace(onsets, other=Other(AGENTS[other]))).copy()
    recorded = onsets.recorded[:, None, other]
    off = np.linalg.norm(positions[:, :, other] - recorded, axis=-1).mean(axis=(1, 2))
    positions[:, :, other] = recorded
    return scores(positions, onsets, agent) | {"off": off}


def answers(onsets: Onsets, simulate: Simulator, agent: str) -> dict[str, Answer]:
    """Return how an agent answers each of `EXCHANGES` of the other one; see `front`."""
    other, out = AGENTS[1 - AGENTS.index(agent)], {}
    for name, acceleration in EXCHANGES[agent].items():
        positions = simulate(replace(onsets, other=Other(other, acceleration)))
        out[name] = _answer(positions, onsets, agent)
    return out


def recorded_answers(onsets: Onsets, agent: str) -> dict[str, Answer]:
    """Return an agent's recorded answers by what the other one did within 1.5 s: NaN where it did something else.

    A car keeps its speed (within 0.3 m/s2), brakes (more than 1 m/s2), accelerates (more than 0.3 m/s2) or stands
    (below 0.3 m/s). A pedestrian walks on (within 0.3 m/s2) or stands.
    """
    rows, first = np.arange(len(onsets)), onsets.interactions.first
    columns = (3, 4) if agent == "pedestrian" else (7, 8)
    begin, later = (np.hypot(*onsets.interactions.motion[rows, at][:, columns].T) for at in (first, first + DECIDED))
    gain, moves = (later - begin) / (DECIDED * STEP), later > STANDS
    did = {
        "keeps_speed": (abs(gain) < KEEPS) & moves, "walks_on": (abs(gain) < KEEPS) & moves,
        "brakes": gain < BRAKES, "accelerates": gain > KEEPS, "stands": ~moves,
    }  # fmt: skip
    own = _answer(onsets.recorded[:, None], onsets, agent)
    return {name: {key: np.where(did[name], value, np.nan) for key, value in own.items()} for name in EXCHANGES[agent]}


def _answer(positions: Floats, onsets: Onsets, agent: str) -> Answer:
    """Return the answer in roll-outs; the speed at the onset is that of constant velocity, tracked."""
    part = AGENTS.index(agent)
    first, last = with_onset(tracked(onsets), onsets.start)[:, :, part, :2], positions[:, :, part, -1 - LAST :]
    begin, later = (np.linalg.norm(np.diff(path, axis=2), axis=-1).mean(axis=-1) / STEP for path in (first, last))
    return {"slower": (later < SLOWER * begin).mean(axis=1), "change": (later - begin).mean(axis=1)}
