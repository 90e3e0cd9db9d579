"""Protocol B: freely simulated critical episodes against recorded near misses, from the onset on.

Both become the same table, at steps of 0.1 s, and go through the same lines. Episodes that the dataset's filters
rejected belong to it, too: generate it with `dataset.keep_rejected=true`.
"""

import math
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import Episode
from vpsci_ros.evaluation.realism.features import features, with_borrowed_noise
from vpsci_ros.evaluation.realism.long_run import long_run, spells_of
from vpsci_ros.evaluation.realism.onsets import Onsets, find_onsets
from vpsci_ros.evaluation.realism.two_sample import REPETITIONS, two_sample
from vpsci_ros.safety import CRITICAL_TTC
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
STOOD, LEAPT = 0.3, 2.5  # [m/s] below it, and [m/s2] from it on
_BEFORE = 20  # steps, 2 s
AFTER = 50  # steps after the onset, 5 s, that are looked at: recorded tracks end soon, simulated episodes at the goal
_SLOWER = 0.8  # of the speed at the onset: slower by a fifth
JUMP = 1.0  # [m/s2] of the vehicle's acceleration at the onset


def free(table: pl.DataFrame, dataset: Dataset, episodes: int, seed: int) -> dict[str, Any]:
    """Return Protocol B's part of `vpsci realism --json`: what both are like, and two tests by a classifier.

    Where the table has several sources, each is a side of its own, too, `recorded_SOURCE`.

    :param table: recorded near misses of whole tracks; episodes: at most so many of the dataset.
    :raises InvalidInput: the dataset cannot be read, or has no critical episode with 3 s after its onset.
    """
    made = as_near_misses(dataset, episodes, seed)
    names = sorted(set(table["source"])) if table["source"].n_unique() > 1 else []
    sides = {"recorded": table, "generated": made}
    sides |= {f"recorded_{name}": table.filter(pl.col("source") == name) for name in names}
    onsets = {name: find_onsets(own) for name, own in sides.items()}
    simulated = onsets["generated"]
    tests = {}
    for side in ("recorded", *(f"recorded_{name}" for name in names)):
        here, end = onsets[side], side.removeprefix("recorded")
        clips = here.clip, simulated.clip
        begin = [_start_features(own) for own in (here, simulated)]
        tests[f"onset{end}"] = two_sample(begin[0], [_column(begin[1])], clips, seed, paired=False)
        own = {name: value[:, 0] for name, value in features(here.recorded[:, None], here).items()}
        noisy = [
            with_borrowed_noise(simulated.recorded[:, None], simulated, seed + k, here) for k in range(REPETITIONS)
        ]
        made_of = [features(each, simulated) for each in noisy]
        tests[f"after{end}"] = two_sample(own, made_of, clips, seed, paired=False)
    return {
        "interactions": {name: len(found) for name, found in onsets.items()},
        "described": {name: described(side) for name, side in sides.items()},
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


_MEASURED = ("onset_curvttc", "time_critical", "vehicle_acceleration", "vehicle_top_speed", "correlation")


def described(table: pl.DataFrame) -> dict[str, float]:
    """Return what interactions are like from the onset on, for `AFTER` steps at most: shares and quantiles by name.

    Over whole tracks the two sides could not be compared: who is watched for 20 s slows down, or hurries, some time.
    """
    rows: dict[str, list[float]] = {}
    for whole in table.partition_by("interaction", maintain_order=True):
        ttc = whole["curvttc_causal"].to_numpy()
        if not (ttc < CRITICAL_TTC).any():
            continue
        at = int((ttc < CRITICAL_TTC).argmax())
        part, ttc = whole[: at + AFTER + 1], ttc[: at + AFTER + 1]
        drive = part["veh_speed"].to_numpy()
        walk = np.hypot(part["ped_vx"].to_numpy(), part["ped_vy"].to_numpy())
        gain, pace = _gain(drive), _gain(walk)
        before = slice(max(0, at - _BEFORE), at + 1)
        after = slice(at, len(drive))
        critical = ttc < CRITICAL_TTC
        moving = drive[at] > 0.5 and walk[at] > 0.5 and len(drive) - at > 5
        values = {
            "stood_then_leapt": float(walk[before].min() < STOOD and pace[before].max() >= LEAPT),
            "pedestrian_over_2": float(walk[at] > 2.0),
            "vehicle_over_3": float(drive[at] > 3.0),
            "onset_curvttc": float(ttc[at]),
            "time_critical": float(critical.sum() * STEP),
            "vehicle_acceleration": float(gain[after].max()),
            "vehicle_top_speed": float(drive[after].max()),
            "correlation": float(np.corrcoef(gain[after], pace[after])[0, 1])
            if moving and gain[after].std() > 0.0 and pace[after].std() > 0.0
            else np.nan,
            "jump": float(abs(gain[min(at + 1, len(gain) - 1)] - gain[max(at - 1, 0)]) > JUMP),
            "pedestrian_nearly_stops": float(walk[at] > 0.5 and walk[after].min() < STOOD),
            "second_spell": float(spells_of(critical) > 1),
            "pedestrian_slows": float(walk[after].min() < _SLOWER * walk[at]),
            "vehicle_slows": float(drive[after].min() < _SLOWER * drive[at]),
        }
        for name, value in values.items():
            rows.setdefault(name, []).append(value)
    out = {"interactions": float(len(rows["jump"]))}
    for name, given in rows.items():
        if name in _MEASURED:
            known = np.array(given)[np.isfinite(given)]
            for end, level in (("median", 0.5), ("95", 0.95)):
                out[f"{name}_{end}"] = float(np.quantile(known, level)) if known.size else math.nan
        else:
            out[name] = float(np.mean(given))
    return out


def _gain(speed: Floats) -> Floats:
    return np.gradient(speed) / STEP if len(speed) > 1 else speed * 0.0


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
