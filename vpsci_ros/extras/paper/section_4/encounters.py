"""A row for each interaction: the onset of the risk and its outcome (sections 4.3, 4.5 and 4.6)."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np
import polars as pl

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.data.episode import Episode, batches, yields
from vpsci_ros.data.recorded import recorded_episodes
from vpsci_ros.evaluation.statistics import Units, units_of
from vpsci_ros.extras.paper.section_4.comparison import Floats
from vpsci_ros.safety import CONFLICT_TTC, CRITICAL_TTC
from vpsci_ros.safety.episodes import onset
from vpsci_ros.safety.yielding import Yielded

ACCELERATION_OVER = 0.2  # [s] before the onset, or after it where nothing was seen before

SCHEMA = {
    "group": pl.String,  # scenario, or what intervals of recorded near misses resample
    "onset_curvttc": pl.Float64,  # [s]
    "least_curvttc": pl.Float64,  # [s]
    "distance": pl.Float64,  # [m] between the centres at the onset
    "vehicle_speed": pl.Float64,  # [m/s] at the onset, as are the next three
    "vehicle_acceleration": pl.Float64,  # [m/s2]
    "pedestrian_speed": pl.Float64,
    "pedestrian_acceleration": pl.Float64,
    "conflict": pl.Boolean,
    "vehicle_yields": pl.Boolean,
    "pedestrian_yields": pl.Boolean,
}


def generated_encounters(data: Dataset) -> pl.DataFrame:
    """Return the kept episodes of a dataset as a table of `SCHEMA`, a row for each pedestrian that becomes critical.

    :raises InvalidInput: a file of the dataset is missing or damaged.
    """
    pairs = chain.from_iterable(episode.pairs() for episode in data.read())
    return pl.DataFrame([row for batch in batches(pairs) for row in _rows(batch)], schema=SCHEMA)


def recorded_encounters(near_misses: pl.DataFrame) -> pl.DataFrame:
    """Return a near-miss table as a table of `SCHEMA`, a row an interaction; vehicles have their source's size.

    The onset is that of CurvTTC as known at the step, where that ever becomes critical. Who yielded is classified on
    the whole tracks. Interactions that never become critical have no row.
    """
    parts = near_misses.partition_by("interaction", maintain_order=True)
    causal = (part["curvttc_causal"].to_numpy() for part in parts)
    pairs = zip(recorded_episodes(near_misses), causal, units_in(near_misses).labels, strict=True)
    rows = [row | {"group": str(unit)} for pair, known, unit in pairs for row in _rows([pair], known)]
    return pl.DataFrame(rows, schema=SCHEMA)


def units_in(near_misses: pl.DataFrame) -> Units:
    """Return the clips or groups by which a bootstrap of a near-miss table resamples, see `statistics.units_of`."""
    first = near_misses.unique("interaction", keep="first", maintain_order=True)
    clips = first.select(pl.concat_str("source", "clip", separator="/")).to_series()
    return units_of(clips.to_numpy(), first["group"].to_numpy())


def _rows(pairs: Sequence[Episode], causal: Floats | None = None) -> Iterator[dict[str, Any]]:
    """Yield the rows of pairs that become critical.

    :param causal: CurvTTC [s] as known at the step, which dates the onset where it ever becomes critical.
    """
    for pair, code in zip(pairs, yields(pairs).tolist(), strict=True):
        ttc = pair.known_curvttc[0]
        known = ttc if causal is None or not (causal <= CRITICAL_TTC).any() else causal
        if (at := int(onset(known))) < 0:
            continue
        seen, least = pair.filled(), float(ttc.min())
        back = max(1, round(ACCELERATION_OVER / pair.period))
        begin, end = max(at - back, 0), at if at > 0 else min(back, len(pair) - 1)
        values = {"onset_curvttc": known[at], "least_curvttc": least, "distance": seen.distance[0, at]}
        for agent, speed in {"vehicle": seen.speed, "pedestrian": np.hypot(seen.ped_vx[0], seen.ped_vy[0])}.items():
            values[f"{agent}_speed"] = speed[at]
            values[f"{agent}_acceleration"] = (speed[end] - speed[begin]) / (max(end - begin, 1) * pair.period)
        yield {
            "group": pair.group,
            **{name: float(value) for name, value in values.items()},
            "conflict": least < CONFLICT_TTC,
            "vehicle_yields": bool(code & Yielded.VEHICLE),
            "pedestrian_yields": bool(code & Yielded.PEDESTRIAN),
        }
