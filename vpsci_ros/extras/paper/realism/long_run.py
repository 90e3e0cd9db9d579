"""Statistics of whole episodes after the onset: repeated critical phases, stops, new starts and extremes.

Recorded tracks end soon, simulated episodes at the goal, and a longer track shows more events. So each generated
interaction is watched after its onset for as long as a recorded one, drawn at random, was.
"""

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.recorded import size_of
from vpsci_ros.evaluation.statistics import cluster_counts, interval, units_of
from vpsci_ros.safety import CRITICAL_TTC, clearance
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
STANDS, SETS_OFF = 0.3, 0.8  # [m/s] an agent stands below the one, and goes on from the other
HARD, RUNS = 3.0, 2.5  # [m/s2] of deceleration over half a second, [m/s]
NEAR = 0.5  # [m] between the footprints
_HALF_SECOND = 5  # steps


def long_run(recorded: pl.DataFrame, generated: pl.DataFrame, seed: int) -> dict[str, Any]:
    """Return shares and quantiles of recorded and of generated episodes, as [value, low, high] of a 95% interval.

    Intervals resample `units_of` the recorded side, and single interactions of the generated side, whose scenarios are
    few.

    :param recorded: near misses of whole tracks; generated: `free.as_near_misses`.
    """
    people, made = watched_tracks(recorded, generated, seed)
    first = recorded.unique("interaction", keep="first", maintain_order=True)
    first = first.filter(pl.col("interaction").is_in(list(people)))
    units = units_of(first["clip"].to_numpy(), first["group"].to_numpy())
    sides = {"recorded": (people, units.labels), "generated": (made, np.arange(len(made)))}
    return {name: _summary(list(own.values()), clusters, seed) for name, (own, clusters) in sides.items()}


def watched_tracks(
    recorded: pl.DataFrame, generated: pl.DataFrame, seed: int
) -> tuple[dict[int, Floats], dict[int, Floats]]:
    """Return recorded and generated tracks from the onset on, the latter cut to random lengths of recorded ones."""
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
        length, width = size_of(part)
        apart = clearance(x, y, heading, px, py, length=length, width=width)
        walk = np.hypot(part["ped_vx"].to_numpy(), part["ped_vy"].to_numpy())
        track = np.stack([part["veh_speed"].to_numpy(), walk, ttc, apart], axis=1)
        out[int(part["interaction"][0])] = track[seen][:limit]
    return out


def course(track: Floats) -> dict[str, float]:
    """Return the statistics of one interaction; those of an agent's stop are NaN where the agent never stood.

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
    """Return the number of phases in which bool[T] is true; gaps of up to half a second are ignored.

    Recorded CurvTTC flickers by noise, simulated CurvTTC does not.
    """
    begins = np.flatnonzero(np.diff(critical.astype(int), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(critical.astype(int), append=0) == -1) + 1
    return 1 + int((begins[1:] - ends[:-1] > _HALF_SECOND).sum()) if len(begins) else 0


def _braking(speed: Floats) -> float:
    """Return the strongest mean deceleration [m/s2] over half a second; 0 for a shorter track."""
    if len(speed) <= _HALF_SECOND:
        return 0.0
    return float((speed[:-_HALF_SECOND] - speed[_HALF_SECOND:]).max() / (_HALF_SECOND * STEP))


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
        elif name == "least_clearance_m":
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
