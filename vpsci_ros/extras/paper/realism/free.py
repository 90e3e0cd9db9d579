"""Protocol B: comparison of freely simulated critical episodes with recorded near misses, from the onset on.

Both become the same table, at steps of 0.1 s, and go through the same code. Episodes that the dataset's filters
rejected count, too: generate it with `dataset.keep_rejected=true`.
"""

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import Episode
from vpsci_ros.evaluation.onsets import Onsets, find_onsets
from vpsci_ros.extras.paper.realism.features import features, with_borrowed_noise
from vpsci_ros.extras.paper.realism.long_run import long_run
from vpsci_ros.extras.paper.realism.two_sample import REPETITIONS, two_sample
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]


def free(table: pl.DataFrame, dataset: Dataset, episodes: int, seed: int) -> dict[str, Any]:
    """Return Protocol B's part of `vpsci realism --json`: statistics after the onset, and two classifier tests.

    :param table: recorded near misses of whole tracks; episodes: at most so many of the dataset.
    :raises InvalidInput: the dataset cannot be read, or has no critical episode with 3 s after its onset.
    """
    made = as_near_misses(dataset, episodes, seed)
    onsets = {name: find_onsets(side) for name, side in (("recorded", table), ("generated", made))}
    recorded, simulated = onsets.values()
    units = recorded.units
    held = units.labels, simulated.clip.astype(str)
    begins = [_start_features(side) for side in (recorded, simulated)]
    after = {name: value[:, 0] for name, value in features(recorded.recorded[:, None], recorded).items()}
    made_of = [
        features(with_borrowed_noise(simulated.recorded[:, None], simulated, seed + k, recorded), simulated)
        for k in range(REPETITIONS)
    ]
    tests = {
        "onset": two_sample(begins[0], [_column(begins[1])], held, seed, paired=False),
        "after": two_sample(after, made_of, held, seed, paired=False),
    }
    return {
        "interactions": {name: len(found) for name, found in onsets.items()},
        "units": units.text,
        "long_run": long_run(table, made, seed),
        "c2st_auc": {name: [test.auc, *test.auc_interval] for name, test in tests.items()},
        "given_away_by": {name: test.importance for name, test in tests.items()},
    }


def as_near_misses(dataset: Dataset, episodes: int, seed: int) -> pl.DataFrame:
    """Return a dataset's critical pairs as a near-miss table, with the columns that the measures of realism read.

    A scenario is a clip. Rejected episodes come first, if the dataset holds them, and then kept ones, drawn among all;
    each pedestrian makes an interaction, and those that never become critical are left out.
    """
    share = max(1, episodes // max(1, len(dataset.scenarios)))
    parts: list[pl.DataFrame] = []
    for name in dataset.scenarios:
        left = share
        for rejected in (True, False):
            if rejected and not dataset.holds_rejected(name):
                continue
            names = [one.name for one in dataset.listed(rejected=rejected) if one.group == name]
            drawn = np.random.default_rng([seed, len(parts)]).permutation(len(names))[:left]
            for episode in dataset.read({names[row] for row in drawn}, scenario=name, rejected=rejected):
                for pair in episode.pairs():
                    if (pair.known_curvttc[0, :: _every(pair)] < CRITICAL_TTC).any():
                        parts.append(_near_miss(pair, len(parts)))
            left -= len(drawn)
    return pl.concat(parts) if parts else pl.DataFrame(schema={"interaction": pl.Int64, "curvttc_causal": pl.Float64})


def _every(episode: Episode) -> int:
    """Return how many frames make a step."""
    return max(1, round(STEP / episode.period))


def _near_miss(pair: Episode, number: int) -> pl.DataFrame:
    """Return the rows of a pair, a row a step; frames that nobody saw have the motion seen last."""
    seen, steps = pair.filled(), slice(None, None, _every(pair))
    vehicle = {f"veh_{name}": getattr(seen, name)[steps] for name in ("x", "y", "vx", "vy", "heading", "speed")}
    walk = {name: getattr(seen, name)[0, steps] for name in ("ped_x", "ped_y", "ped_vx", "ped_vy")}
    ttc = pair.known_curvttc[0, steps]
    known = {"interaction": number, "group": number, "source": "generated", "clip": pair.group}
    return pl.DataFrame({**vehicle, **walk, "curvttc": ttc, "curvttc_causal": ttc}).with_columns(
        **{name: pl.lit(value, pl.Int64 if isinstance(value, int) else pl.String) for name, value in known.items()}
    )


def _start_features(onsets: Onsets) -> dict[str, Floats]:
    """Return what the onset and the second before it look like, float64[n] each."""
    motion, first = onsets.interactions.motion, onsets.interactions.first
    row = np.arange(len(onsets))
    start = onsets.start
    heading = np.stack([np.cos(start[:, 2]), np.sin(start[:, 2])], axis=1)
    left = np.stack([-heading[:, 1], heading[:, 0]], axis=1)
    apart, walk = start[:, 5:7] - start[:, 0:2], start[:, 7:9]
    out = {
        "vehicle_speed": np.hypot(start[:, 3], start[:, 4]),
        "pedestrian_speed": np.hypot(walk[:, 0], walk[:, 1]),
        "ahead": (apart * heading).sum(axis=1),
        "beside": np.abs((apart * left).sum(axis=1)),
        "walking_along": (walk * heading).sum(axis=1),
        "walking_across": np.abs((walk * left).sum(axis=1)),
        "curvttc": np.minimum(onsets.interactions.curvttc[row, first], CRITICAL_TTC),
    }
    for back in (5, 10):
        earlier = motion[row, np.maximum(first - back, 0)]
        known = np.maximum(np.minimum(first, back), 1) * STEP
        out[f"vehicle_gain_{back}"] = (out["vehicle_speed"] - np.hypot(earlier[:, 3], earlier[:, 4])) / known
        out[f"pedestrian_gain_{back}"] = (out["pedestrian_speed"] - np.hypot(earlier[:, 7], earlier[:, 8])) / known
    return out


def _column(values: dict[str, Floats]) -> dict[str, Floats]:
    return {name: value[:, None] for name, value in values.items()}
