"""A surrogate model of a driving system, learned from episodes that it has driven.

Behavioural cloning (Pomerleau 1989, "ALVINN") of the acceleration alone, by gradient-boosted trees, from what could be
seen of the last half second: place and velocity of the nearest pedestrian in the vehicle's frame, CurvTTC, its own
speed and curvature, and where on the map it is. The world keeps the surrogate in its lane. It only says where to look;
its errors show in the episodes that the driving system then drives itself.
"""

from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Episode
from vpsci_ros.safety import HORIZON, clearance
from vpsci_ros.world import EPISODE, IDLE, RUNNING
from vpsci_ros.world.observation import arrays_to_heading_frame

Floats32 = NDArray[np.float32]
LAGS = (0, 2, 4, 6, 8, 10)  # [ticks]
_NOW = ("vehicle_curvature", "vehicle_acceleration", "vehicle_x", "vehicle_y", "scenario")
HOLDING = -2.0  # [m/s2] what a vehicle that stays where it stands is taken to do, so that its stand-in does not creep
_AHEAD = 10.0  # [s] of the time to reach the pedestrian, beyond which all count as the same


class Recent:
    """The last ticks of each episode, as features.

    :param pedestrians: records of an episode.
    """

    def __init__(self, pedestrians: int = 1) -> None:
        self._most = pedestrians
        self._past: list[Floats32] = []
        self._key: NDArray[np.int64] | None = None

    def features(self, state: NDArray[np.void], curvttc: NDArray[np.float64]) -> tuple[Floats32, NDArray[np.int64]]:
        """Return features float32[E, 43] of E episodes, and the record index of the nearest pedestrian of each episode.

        :param curvttc: float64[B] [s].
        """
        rows = nearest(state, self._most)
        near = state[rows]
        seen = _seen(near, np.fmin(curvttc[rows], HORIZON))
        key = np.stack([near["scenario"], near["episode"]]).astype(np.int64)
        if self._key is not None:
            begun = (key != self._key).any(axis=0) | (near["frame"] == 0)
            for past in self._past:
                past[begun] = seen[begun]
        self._key = key
        self._past = [*self._past[-max(LAGS) :], seen]
        history = [self._past[max(len(self._past) - 1 - lag, 0)] for lag in LAGS]
        forward, left, along, across, speed, _ = seen.T
        time = np.clip(forward / np.maximum(speed - along, 0.1), -_AHEAD, _AHEAD)
        now = (near[name] for name in _NOW)
        return np.column_stack([*history, *now, time, left + across * time]).astype(np.float32), rows


def nearest(state: NDArray[np.void], pedestrians: int) -> NDArray[np.int64]:
    """Return the record of the pedestrian nearest the vehicle in each episode of EPISODE[B], int64[B / pedestrians]."""
    first = np.arange(0, len(state), pedestrians)
    if pedestrians == 1:
        return first
    place = ("vehicle_x", "vehicle_y", "vehicle_heading", "pedestrian_x", "pedestrian_y")
    gap = np.where(state["status"] == IDLE, np.inf, clearance(*(state[name] for name in place)))
    chosen: NDArray[np.int64] = first + gap.reshape(-1, pedestrians).argmin(axis=1)
    return chosen


def _seen(state: NDArray[np.void], curvttc: NDArray[np.float64]) -> Floats32:
    """Return the pedestrian in the vehicle's frame [m, m/s], the vehicle's speed and CurvTTC [s], float32[E, 6]."""
    place = np.stack([state[f"pedestrian_{axis}"] - state[f"vehicle_{axis}"] for axis in "xy"], axis=1)
    velocity = np.stack([state["pedestrian_vx"], state["pedestrian_vy"]], axis=1)
    place, velocity = (arrays_to_heading_frame(state["vehicle_heading"], vectors) for vectors in (place, velocity))
    return np.column_stack([place, velocity, state["vehicle_speed"], curvttc]).astype(np.float32)


def lessons(episodes: Iterable[Episode], pedestrians: int) -> tuple[Floats32, Floats32]:
    """Return training data of the surrogate: features float32[n, 43], accelerations float32[n] [m/s2]."""
    seen, done = [], []
    for episode in episodes:
        recent, accelerations = Recent(pedestrians), np.diff(episode.speed) / episode.period
        for frame, acceleration in enumerate(accelerations):
            features, _ = recent.features(*_tick(episode, frame, pedestrians))
            stays = episode.speed[frame] == episode.speed[frame + 1] == 0.0
            seen.append(features[0])
            done.append(HOLDING if stays else float(acceleration))
    return np.array(seen, np.float32), np.array(done, np.float32)


def _tick(episode: Episode, frame: int, pedestrians: int) -> tuple[NDArray[np.void], NDArray[np.float64]]:
    """Return one frame of an episode as EPISODE[P], and CurvTTC float64[P] [s]."""
    state, count = np.zeros(pedestrians, EPISODE), episode.pedestrians
    curvttc = np.full(pedestrians, np.inf)
    state["scenario"], state["episode"], state["frame"] = *episode.key, frame
    state["status"][:count] = RUNNING
    for name in ("x", "y", "heading", "speed", "curvature"):
        state[f"vehicle_{name}"] = getattr(episode, name)[frame]
    if frame:
        state["vehicle_acceleration"] = (episode.speed[frame] - episode.speed[frame - 1]) / episode.period
    for name in ("x", "y", "vx", "vy"):
        state[f"pedestrian_{name}"][:count] = getattr(episode, f"ped_{name}")[:, frame]
    curvttc[:count] = episode.curvttc[:, frame]
    return state, curvttc


class Imitation:
    """A surrogate driver, which predicts the system's acceleration from similar features.

    :param seen, done: of `lessons`.
    """

    def __init__(self, seen: Floats32, done: Floats32, seed: int) -> None:
        from sklearn.ensemble import HistGradientBoostingRegressor
        from threadpoolctl import threadpool_limits

        model: Any = HistGradientBoostingRegressor(
            max_iter=200, learning_rate=0.12, max_leaf_nodes=63, min_samples_leaf=10, l2_regularization=1.0,
            early_stopping=False, random_state=seed % 2**32,
        )  # fmt: skip
        self.one_thread = partial(threadpool_limits, 1)  # several wait for each other, for ever on a busy machine
        """Makes a context manager for `drive`, which limits it to one thread, so results are the same everywhere."""
        with self.one_thread():
            self._model = model.fit(seen, done)

    def drive(self, features: Floats32) -> Floats32:
        """Return accelerations [m/s2], float32[E], for features float32[E, 43]."""
        answer: Floats32 = self._model.predict(features).astype(np.float32)
        return answer
