"""Kinds of pedestrian: walking speed, acceleration when it sets off, and reaction.

An adult acts as its policy does. The other kinds differ by the numbers below; docs/world.md names the source of each
and which are assumed. Draws of the kind have a stream of their own, so adults are bit-identical to pedestrians without
kinds.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import parameter, values_of
from vpsci_ros.world.calibration import START_ACCELERATION
from vpsci_ros.world.compiled import kernel
from vpsci_ros.world.counter_rng import STREAM_KIND, draw, normal_pair, unit

KINDS = ("adult", "older", "child", "distracted", "wheelchair", "stroller")
ADULT, CHILD = KINDS.index("adult"), KINDS.index("child")
# in the order of KINDS; the speeds of an adult are the spawn's own
SPEED = np.array([math.nan, 1.16, 2.60, 1.04, 1.16, 1.08])  # [m/s] mean
SPEED_SPREAD = np.array([math.nan, 0.23, 0.40, 0.20, 0.23, 0.17])  # [m/s] standard deviation
TOP_SPEED = np.array([math.inf, 2.0, 4.5, 3.0, 2.0, 2.5])  # [m/s] under a policy, too
SET_OFF = np.array([START_ACCELERATION, 0.6, 2.5, START_ACCELERATION, 0.6, 0.7])  # [m/s2] from the kerb
REACTING = np.array([1.0, 0.9, 0.5, 0.8, 0.9, 1.0])  # share that reacts to the vehicle at all
LATENCY = np.array([0.0, 0.4, 0.8, 1.5, 0.3, 0.0])  # [s] median, beyond an adult's
LATENCY_SPREAD = 0.4  # standard deviation of its logarithm
_WITHIN = 2.0  # standard deviations


@dataclass(frozen=True)
class KindMixture:
    """Relative frequencies of the kinds of pedestrians.

    :raises InvalidInput: all of them are 0.
    """

    adult: float = parameter(1.0, "relative frequency of adults, who walk as the spawn draws", low=0.0, high=1e6)
    older: float = parameter(0.0, "relative frequency of pedestrians above 65 years", low=0.0, high=1e6)
    child: float = parameter(0.0, "relative frequency of children, who wait at the kerb, then run", low=0.0, high=1e6)
    distracted: float = parameter(0.0, "relative frequency of adults who react late or never", low=0.0, high=1e6)
    wheelchair: float = parameter(0.0, "relative frequency of wheelchair users", low=0.0, high=1e6)
    stroller: float = parameter(0.0, "relative frequency of adults with a stroller", low=0.0, high=1e6)

    def __post_init__(self) -> None:
        if not sum(self.parts) > 0.0:
            raise InvalidInput(f"kinds: expected a part above 0 for at least one of {', '.join(KINDS)}, got none")

    @property
    def parts(self) -> list[float]:
        """The relative frequency of each of `KINDS`."""
        return list(values_of(self).values())

    def limits(self) -> NDArray[np.float64]:
        """Return the cumulative shares of `KINDS`, float64[6]."""
        return np.cumsum(self.parts) / sum(self.parts)


@kernel
def draw_kind(episode, seed, limits):  # type: ignore[no-untyped-def]
    """Draw an EPISODE record's kind of pedestrian by `KindMixture.limits`, and its reaction delay [s]."""
    episode.kind, episode.reaction_delay = ADULT, 0.0
    if limits[ADULT] >= 1.0:
        return
    drawn = draw(episode, seed, STREAM_KIND, 0)
    share, kind = unit(drawn[0]), 0
    while kind < limits.size - 1 and share >= limits[kind]:
        kind += 1
    episode.kind = kind
    if unit(drawn[1]) >= REACTING[kind]:
        episode.reaction_delay = math.inf
    elif LATENCY[kind] > 0.0:
        deviation, _ = normal_pair(unit(drawn[2]), unit(drawn[3]))
        episode.reaction_delay = LATENCY[kind] * math.exp(LATENCY_SPREAD * deviation)


@kernel
def speed_of_kind(episode, seed, adults):  # type: ignore[no-untyped-def]
    """Return the walking speed [m/s] of a record's pedestrian; `adults` is the speed of an adult."""
    if episode.kind == ADULT:
        return adults
    drawn = draw(episode, seed, STREAM_KIND, 1)
    deviation, _ = normal_pair(unit(drawn[0]), unit(drawn[1]))
    return SPEED[episode.kind] + SPEED_SPREAD[episode.kind] * min(_WITHIN, max(-_WITHIN, deviation))
