"""Protocol B: freely simulated critical episodes against recorded near misses, from the onset on.

Both become the same table, at steps of 0.1 s, and go through the same lines. Episodes that the dataset's filters
rejected belong to it, too: generate it with `dataset.keep_rejected=true`.
"""

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import Episode
from vpsci_ros.data.recorded import vehicle_size
from vpsci_ros.evaluation.onsets import Onsets, find_onsets
from vpsci_ros.evaluation.statistics import cluster_counts, interval
from vpsci_ros.extras.paper.realism.features import features, with_borrowed_noise
from vpsci_ros.extras.paper.realism.two_sample import REPETITIONS, two_sample
from vpsci_ros.safety import CRITICAL_TTC, clearance
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]


# ---- What becomes of it after the first seconds: second spells, stops and set-offs, time to clear, and the tails.
#
# Recorded tracks end soon, simulated episodes at the goal, and who is watched longer does more. So each generated
# interaction is watched for as long after its onset as a recorded one, drawn at random, was.


STANDS, SETS_OFF = 0.3, 0.8  # [m/s] an agent stands below the one, and goes on from the other
HARD, RUNS = 3.0, 2.5  # [m/s2] of deceleration over half a second, [m/s]
NEAR = 0.5  # [m] between the footprints
_HALF_SECOND = 5  # steps


def long_run(recorded: pl.DataFrame, generated: pl.DataFrame, seed: int) -> dict[str, Any]:
    """Return, for each side, shares and quantiles with 95% intervals, [value, low, high] by name.

    Intervals resample clips: of the generated side scenarios are few, so its interactions are resampled.

    :param recorded: near misses of whole tracks; generated: `free.as_near_misses`.
    """
    people, made = watched_tracks(recorded, generated, seed)
    clips = [recorded.filter(pl.col("interaction") == number)["clip"][0] for number in people]
    sides = {"recorded": (people, np.array(clips)), "generated": (made, np.arange(len(made)))}
    return {name: _summary(list(own.values()), clusters, seed) for name, (own, clusters) in sides.items()}


def watched_tracks(
    recorded: pl.DataFrame, generated: pl.DataFrame, seed: int
) -> tuple[dict[int, Floats], dict[int, Floats]]:
    """Return the tracks of both sides from the onset on, as `_tracks` has them, the generated ones cut as the drawn."""
    people = _tracks(recorded)
    lengths = np.array([len(track) for track in people.values()])
    drawn = np.random.default_rng([seed, 1]).choice(lengths, size=generated["interaction"].n_unique())
    return people, _tracks(generated, drawn)


def _tracks(table: pl.DataFrame, lengths: NDArray[np.int64] | None = None) -> dict[int, Floats]:
    """Return interaction -> vehicle's speed, walking speed, CurvTTC, clearance from the onset on, float64[T, 4].

    :param lengths: steps that are kept of each interaction that becomes critical, at most.
    """
    out: dict[int, Floats] = {}
    for part in table.partition_by("interaction", maintain_order=True):
        ttc = part["curvttc_causal"].to_numpy()
        critical = ttc < CRITICAL_TTC
        if not critical.any():
            continue
        limit = None if lengths is None else int(lengths[len(out)])
        seen = slice(int(critical.argmax()), None)
        x, y, heading, px, py = (part[name].to_numpy() for name in ("veh_x", "veh_y", "veh_heading", "ped_x", "ped_y"))
        length, width = vehicle_size(part["source"][0])
        apart = clearance(x, y, heading, px, py, length=length, width=width)
        walk = np.hypot(part["ped_vx"].to_numpy(), part["ped_vy"].to_numpy())
        track = np.stack([part["veh_speed"].to_numpy(), walk, ttc, apart], axis=1)
        out[int(part["interaction"][0])] = track[seen][:limit]
    return out


def course(track: Floats) -> dict[str, float]:
    """Return what one interaction came to; NaN where the question does not arise: who never stood sets off never.

    :param track: float64[T, 4] of the vehicle's speed, walking speed [m/s], CurvTTC [s], clearance [m] from the onset.
    """
    drive, walk, ttc, apart = track.T
    critical = ttc < CRITICAL_TTC
    out = {
        "watched_s": len(track) * STEP,
        "clear_after_s": float(np.flatnonzero(critical)[-1] + 1) * STEP,
        "second_spell": float(spells_of(critical) > 1),
        "least_clearance_m": float(apart.min()),
        "nearer_than_half_a_metre": float(apart.min() < NEAR),
        "vehicle_brakes_hard": float(_braking(drive) >= HARD),
        "pedestrian_runs": float(walk.max() >= RUNS),
    }
    for who, speed in (("vehicle", drive), ("pedestrian", walk)):
        stops = np.flatnonzero(speed < STANDS)
        out[f"{who}_stands"] = float(stops.size > 0)
        out[f"{who}_sets_off_again"] = float((speed[stops[0] :] > SETS_OFF).any()) if stops.size else np.nan
        out[f"{who}_stands_for_s"] = float(stops.size) * STEP if stops.size else np.nan
    return out


def spells_of(critical: NDArray[np.bool_]) -> int:
    """Return in how many spells bool[T] is true: what comes again within half a second is the same spell.

    Recorded CurvTTC flickers by noise, simulated CurvTTC does not.
    """
    begins = np.flatnonzero(np.diff(critical.astype(int), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(critical.astype(int), append=0) == -1) + 1
    return 1 + int((begins[1:] - ends[:-1] > _HALF_SECOND).sum()) if len(begins) else 0


def _braking(speed: Floats) -> float:
    """Return the strongest mean deceleration [m/s2] over half a second."""
    if len(speed) <= _HALF_SECOND:
        return 0.0
    return float((speed[:-_HALF_SECOND] - speed[_HALF_SECOND:]).max() / (_HALF_SECOND * STEP))


_TAIL = "least_clearance_m"


def _summary(tracks: list[Floats], clusters: NDArray[Any], seed: int) -> dict[str, list[float]]:
    rows = [course(track) for track in tracks]
    counts = cluster_counts(clusters, seed, 500)
    out: dict[str, list[float]] = {"interactions": [float(len(rows))] * 3}
    for name in rows[0]:
        values = np.array([row[name] for row in rows])
        known = np.isfinite(values)
        own, weights = values[known], counts[:, known]
        if name.endswith("_s"):
            out[f"{name}_median"] = _quantile(own, weights, 0.5)
        elif name == _TAIL:
            out[f"{name}_5"] = _quantile(own, weights, 0.05)
        else:
            total = weights.sum(axis=1)
            draws = np.divide(weights @ own, total, out=np.full(len(total), np.nan), where=total > 0.0)
            out[name] = [float(own.mean()) if own.size else np.nan, *interval(draws)]
    return out


def _quantile(values: Floats, weights: Floats, level: float) -> list[float]:
    """Return the quantile, and its interval by resamples, where each value counts so often (`weights` [count, n])."""
    if not values.size:
        return [np.nan] * 3
    order = np.argsort(values)
    total = np.cumsum(weights[:, order], axis=1)
    at = (total < level * total[:, -1:]).sum(axis=1).clip(0, len(values) - 1)
    return [float(np.quantile(values, level)), *interval(values[order][at])]


def free(table: pl.DataFrame, dataset: Dataset, episodes: int, seed: int) -> dict[str, Any]:
    """Return Protocol B's part of `vpsci realism --json`: the long run, and two tests by a classifier.

    :param table: recorded near misses of whole tracks; episodes: at most so many of the dataset.
    :raises InvalidInput: the dataset cannot be read, or has no critical episode with 3 s after its onset.
    """
    made = as_near_misses(dataset, episodes, seed)
    onsets = {name: find_onsets(side) for name, side in (("recorded", table), ("generated", made))}
    recorded, simulated = onsets.values()
    clips = recorded.clip, simulated.clip
    begins = [_start_features(side) for side in (recorded, simulated)]
    after = {name: value[:, 0] for name, value in features(recorded.recorded[:, None], recorded).items()}
    made_of = [
        features(with_borrowed_noise(simulated.recorded[:, None], simulated, seed + k, recorded), simulated)
        for k in range(REPETITIONS)
    ]
    tests = {
        "onset": two_sample(begins[0], [_column(begins[1])], clips, seed, paired=False),
        "after": two_sample(after, made_of, clips, seed, paired=False),
    }
    return {
        "interactions": {name: len(found) for name, found in onsets.items()},
        "long_run": long_run(table, made, seed),
        "c2st_auc": {name: [test.auc, *test.auc_interval] for name, test in tests.items()},
        "c2st_auc_spread": {name: test.spread for name, test in tests.items()},
        "given_away_by": {name: test.importance for name, test in tests.items()},
    }


def as_near_misses(dataset: Dataset, episodes: int, seed: int) -> pl.DataFrame:
    """Return episodes of a dataset in the columns of a near-miss table that measures of realism read.

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
    known = {"interaction": number, "source": "generated", "clip": pair.group}
    return pl.DataFrame({**vehicle, **walk, "curvttc": ttc, "curvttc_causal": ttc}).with_columns(
        **{name: pl.lit(value, pl.Int64 if name == "interaction" else pl.String) for name, value in known.items()}
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
