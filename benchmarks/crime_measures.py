"""Measures of CommonRoad CriMe on our exports, beside ours of the same episodes.

    pip install '.[commonroad]' commonroad-crime          # an environment without the extra osi
    vpsci generate -o out/crime --params params/stage3_generate.yaml --episodes 60 --set world_simulator.scenarios=[1]
    python benchmarks/crime_measures.py out/crime [--every 4] [--most 36]

Each episode is exported to CommonRoad with its vehicle, read by commonroad-io, and measured at every so many steps. DCE
is the least distance of the footprints that comes, so at step 0 it should be our least clearance. TTC (along the lane,
of what is in the same lanelet) and WTTC (worst case: both may go anywhere) are compared by their least value with our
least CurvTTC; so is TTCE, the time until DCE, at the step at which CurvTTC first falls below 5 s.
"""

import argparse
import logging
import tempfile
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad_crime.data_structure.configuration import CriMeConfiguration
from commonroad_crime.measure import DCE, TTC, TTCE, WTTC
from scipy.stats import spearmanr

from vpsci_ros.data.episode import Episode
from vpsci_ros.episodes import read_episodes
from vpsci_ros.extras.formats.commonroad import PEDESTRIAN, VEHICLE
from vpsci_ros.extras.formats.run import Options, export
from vpsci_ros.safety import CRITICAL_TTC, clearance


def measured(path: Path, steps: range, onset: int) -> dict[str, float]:
    """Return CriMe's measures of an exported episode: DCE, the least TTC and WTTC, TTCE at the onset."""
    scenario, _ = CommonRoadFileReader(str(path)).open(lanelet_assignment=True)
    config = CriMeConfiguration()
    config.update(ego_id=VEHICLE, sce=scenario)
    found: dict[str, Any] = {"DCE": DCE(config).compute(PEDESTRIAN, 0, verbose=False)}
    for kind in (TTC, WTTC):
        measure = kind(config)
        found[kind.__name__] = np.nanmin([measure.compute(PEDESTRIAN, step, verbose=False) for step in steps])
    found["TTCE"] = TTCE(config).compute(PEDESTRIAN, onset, verbose=False)
    return {name: float(value) for name, value in found.items()}


def ours(episode: Episode) -> tuple[dict[str, float], int]:
    """Return our least clearance [m] and least CurvTTC [s] of an episode, and the frame of its onset."""
    seen = episode.filled()
    near = clearance(seen.x, seen.y, seen.heading, seen.ped_x[0], seen.ped_y[0])
    curvttc = np.nan_to_num(seen.curvttc[0], nan=np.inf)
    below = np.flatnonzero(curvttc < CRITICAL_TTC)
    return {"clearance": float(near.min()), "curvttc": float(curvttc.min())}, int(below[0]) if len(below) else 0


def correlated(name: str, theirs: np.ndarray, own: np.ndarray) -> str:
    """Return a row: how often theirs is finite, its median, and the rank correlation with ours where it is."""
    finite = np.isfinite(theirs)
    row = f"| {name} | {finite.mean():.0%} | "
    if finite.sum() < 10:
        return f"{row}- | - |"
    rng = np.random.default_rng(0)
    draws = [rng.integers(finite.sum(), size=finite.sum()) for _ in range(1000)]
    pairs = theirs[finite], own[finite]
    low, high = np.nanquantile([spearmanr(pairs[0][d], pairs[1][d]).statistic for d in draws], [0.025, 0.975])
    return f"{row}{np.median(pairs[0]):.2f} | {spearmanr(*pairs).statistic:.2f} [{low:.2f}, {high:.2f}] |"


def main() -> None:
    """Export, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path, help="bag, dataset or exam")
    parser.add_argument("--every", type=int, default=4, help="steps between two looks")
    parser.add_argument("--most", type=int, help="episodes, the first ones; some seconds each; default: all")
    given = parser.parse_args()
    logging.disable(logging.CRITICAL)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        export(given.source, ["commonroad"], Path(folder) / "out", Options(vehicle="trajectory"))
        for number, episode in enumerate(islice(read_episodes(given.source), given.most)):
            own, onset = ours(episode)
            steps = range(0, len(episode.time) - 1, given.every)
            path = Path(folder) / "out" / "commonroad" / f"{episode.label}.xml"
            rows.append(own | measured(path, steps, onset))
            print(f"{number + 1}: {episode.label} {rows[-1]}", flush=True)
    table = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    apart = table["DCE"] - table["clearance"].clip(0.0)
    print(f"\nn = {len(rows)} episodes; DCE less our least clearance: {apart.min():.3f} to {apart.max():.3f} m")
    print("\n| CriMe's | finite | median | rank correlation with our least CurvTTC |\n|---|---|---|---|")
    for name in ("TTC", "WTTC", "TTCE", "DCE"):
        print(correlated(name, table[name], table["curvttc"]))


if __name__ == "__main__":
    main()
