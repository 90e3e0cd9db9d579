"""Recorded motion that the replay drivers follow: from a data set, a bag or an earlier run."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world.tables import Recordings

NO_RECORDINGS = Recordings(np.empty((0, 0, 5)), np.empty((0, 0, 4)), np.empty(0, np.int64))


class Recorded:
    """Recorded motion of both agents for some episodes, one frame for each tick of the world.

    :param episodes: (scenario number, episode number) -> (vehicle, pedestrian) with vehicle float[T, 5] as (x, y,
        heading, speed, curvature) and pedestrian float[T, 4] as (x, y, vx, vy), metres, radians, seconds, frame 0
        first. The agent that is not replayed may be all zeros.
    :raises InvalidInput: no episodes, a wrong shape, numbers that are not finite, a negative speed, or agents with
        different numbers of frames.
    """

    def __init__(self, episodes: Mapping[tuple[int, int], tuple[ArrayLike, ArrayLike]]) -> None:
        if not episodes:
            raise InvalidInput("recordings: expected at least one episode, got none")
        pairs = {
            key: (_array(v, 5, key, "vehicle"), _array(p, 4, key, "pedestrian")) for key, (v, p) in episodes.items()
        }
        longest = max(len(vehicle) for vehicle, _ in pairs.values())
        vehicles, pedestrians = np.zeros((len(pairs), longest, 5)), np.zeros((len(pairs), longest, 4))
        frames = np.zeros(len(pairs), np.int64)
        for n, (key, (vehicle, pedestrian)) in enumerate(pairs.items()):
            if len(vehicle) != len(pedestrian):
                raise InvalidInput(
                    f"recording of scenario {key[0]}, episode {key[1]}: expected as many frames for both agents, got "
                    f"{len(vehicle)} and {len(pedestrian)}"
                )
            if (vehicle[:, 3] < 0.0).any():
                raise InvalidInput(f"recording of scenario {key[0]}, episode {key[1]}: the vehicle's speed is negative")
            vehicles[n, : len(vehicle)], pedestrians[n, : len(vehicle)], frames[n] = vehicle, pedestrian, len(vehicle)
        self.arrays = Recordings(vehicles, pedestrians, frames)
        self._rows = {key: n for n, key in enumerate(pairs)}

    def row(self, scenario: int, episode: int) -> int:
        """Return the row of an episode in `arrays`.

        :raises InvalidInput: the episode was not recorded.
        """
        if (scenario, episode) not in self._rows:
            raise InvalidInput(
                f"scenario {scenario}, episode {episode}: a replay driver needs its recording; none given"
            )
        return self._rows[scenario, episode]


def _array(values: ArrayLike, columns: int, key: tuple[int, int], agent: str) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != columns or len(array) == 0 or not np.isfinite(array).all():
        raise InvalidInput(
            f"recording of scenario {key[0]}, episode {key[1]}: expected finite numbers [frames, {columns}] for the "
            f"{agent}, got shape {array.shape}"
        )
    return array
