"""Protocol C: reactions classified from video at 34 signalised intersections, beside those of generated episodes.

Singleton et al., "Safety impacts of right turns on pedestrians", UDOT-20.312, 2023, data doi 10.5281/zenodo.15710869
(CC BY 4.0): each conflict of a pedestrian with a right-turning vehicle has an encroachment time in whole seconds, one
reaction of the driver and one of the pedestrian. Reactions in near misses and in generated episodes are read off
speeds by the thresholds below, and their encroachment time is the PET. What a person says of a video and what a
threshold says of a speed are not the same; so the column to compare with is that of recorded near misses, which are
classified by the same thresholds.
"""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.documents import require_regular
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.realism.free import as_near_misses
from vpsci_ros.safety import CRITICAL_TTC, post_encroachment_time
from vpsci_ros.safety.paths import first_crossing
from vpsci_ros.world.observation import STEP

WITHIN = (3, 5)  # [s] of encroachment time
SLOWED, SPED_UP, STOPPED = 0.2, 0.2, 0.3  # shares of the speed at the onset; below [m/s] an agent stands
_WALKED = 0.3  # [m/s] below it at the onset a pedestrian waits already
DRIVER = {
    "No obvious reaction": "none",
    "Driver slowed down": "slows",
    "Driver fully stopped": "stops",
    "Driver sped up": "speeds up",
    "Driver swerved": "swerves",
}
PEDESTRIAN = {
    "No obvious reaction": "none",
    "Stopped and waited for the vehicle": "waits or slows",
    "Slowed down to avoid collision": "waits or slows",
    "Sped up to avoid collision": "hurries or runs",
    "Ran to avoid collision": "hurries or runs",
    "Changed direction": "turns aside",
}
_TIME, _DRIVER, _PEDESTRIAN = "Encroachment_Time", "Reaction.to.conflict", "Ped.Reaction"
_FIRST = "Encroachment.Car.After.Ped"


def elsewhere(conflicts: Path, table: pl.DataFrame, dataset: Dataset | None, episodes: int) -> dict[str, Any]:
    """Return Protocol C's part of `vpsci realism --json`: shares of reactions, `video`, `near_misses` and `generated`.

    :param conflicts: `datlong.csv` of the study; table: recorded near misses; episodes: at most so many of the dataset.
    :raises InvalidInput: the file does not hold the study's columns or reactions.
    """
    sides = {"video": read_conflicts(conflicts), "near_misses": reactions(table)}
    if dataset is not None:
        sides["generated"] = reactions(as_near_misses(dataset, episodes, 0))
    return {f"within_{limit}_s": {name: _shares(own, limit) for name, own in sides.items()} for limit in WITHIN}


def read_conflicts(path: Path) -> pl.DataFrame:
    """Return encroachment time [s], driver, pedestrian, and whether the pedestrian went first, of every conflict.

    :raises InvalidInput: not readable, a column is missing, or a reaction is not one of the study's.
    """
    require_regular(path)
    try:
        table = pl.read_csv(path, infer_schema=False)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InvalidInput(f"{path}: not readable as CSV: {error}; take datlong.csv as published") from error
    if missing := [name for name in (_TIME, _DRIVER, _PEDESTRIAN, _FIRST) if name not in table.columns]:
        raise InvalidInput(f"{path}: column {missing[0]} is missing; take datlong.csv as published")
    for name, known in ((_DRIVER, DRIVER), (_PEDESTRIAN, PEDESTRIAN)):
        if strange := sorted(set(table[name].drop_nulls()) - set(known) - {"NA"}):
            raise InvalidInput(f"{path}: column {name}: expected one of {', '.join(known)}, got {strange[0]!r}")
    return table.select(
        pl.col(_TIME).cast(pl.Float64, strict=False).abs().alias("time"),
        pl.col(_DRIVER).replace_strict(DRIVER, default=None).alias("driver"),
        pl.col(_PEDESTRIAN).replace_strict(PEDESTRIAN, default=None).alias("pedestrian"),
        (pl.col(_FIRST) == "TRUE").alias("pedestrian_first"),
    ).drop_nulls()


def reactions(table: pl.DataFrame) -> pl.DataFrame:
    """Return the same columns of simulated or recorded near misses in which both cross the other's path.

    From the onset to the later arrival: who comes below 0.3 m/s stops, who loses a fifth of the speed of the onset
    slows, who gains a fifth of it (and lost none) speeds up or hurries.
    """
    rows = []
    for part in table.partition_by("interaction", maintain_order=True):
        ttc = part["curvttc_causal"].to_numpy()
        x, y, heading, px, py = (part[name].to_numpy() for name in ("veh_x", "veh_y", "veh_heading", "ped_x", "ped_y"))
        pet, arrival = post_encroachment_time(x, y, heading, px, py, dt=STEP)
        if np.isnan(pet) or not (ttc < CRITICAL_TTC).any():
            continue
        at = int((ttc < CRITICAL_TTC).argmax())
        until = max(at + 2, int(np.ceil(arrival / STEP)) + 1)
        driver = _reaction(part["veh_speed"].to_numpy()[at:until])
        walk = np.hypot(part["ped_vx"].to_numpy(), part["ped_vy"].to_numpy())[at:until]
        pedestrian = _OF_PEDESTRIAN[_reaction(walk)] if walk[0] > _WALKED else "waits or slows"
        driven, walked, _, _ = first_crossing(x, y, 0.0, heading[-1], px, py)
        rows.append((float(pet), driver, pedestrian, bool(walked < driven)))
    schema = {"time": pl.Float64, "driver": pl.String, "pedestrian": pl.String, "pedestrian_first": pl.Boolean}
    return pl.DataFrame(rows, schema=schema, orient="row")


_OF_PEDESTRIAN = {"stops": "waits or slows", "slows": "waits or slows", "speeds up": "hurries or runs", "none": "none"}


def _reaction(speed: NDArray[np.float64]) -> str:
    begin, least, most = float(speed[0]), float(speed.min()), float(speed.max())
    if least < STOPPED < begin:
        return "stops"
    if least < (1.0 - SLOWED) * begin:
        return "slows"
    return "speeds up" if most > (1.0 + SPED_UP) * begin + 0.1 else "none"


def _shares(reactions: pl.DataFrame, limit: int) -> dict[str, Any]:
    near = reactions.filter(pl.col("time") <= limit)
    whole = {"conflicts": near.height}
    if near.is_empty():
        return whole
    parts = {
        name: {key: float((near[name] == key).to_numpy().mean()) for key in dict.fromkeys(kinds.values())}
        for name, kinds in (("driver", DRIVER), ("pedestrian", PEDESTRIAN))
    }
    return whole | parts | {"pedestrian_first": float(near["pedestrian_first"].to_numpy().mean())}
