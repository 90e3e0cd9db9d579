"""Our pedestrian and SUMO's own before SUMO's cars, on the same episodes: collisions, conflicts, time lost.

    python benchmarks/sumo_pedestrians.py --episodes 100 -o out/sumo.json --picture docs/sumo.png

Plays `examples/sumo_crossing.py` (extra: sumo) with either pedestrian and with nobody. Left out are episodes whose
pedestrian begins standing or on the lane, since SUMO's always begins on its pavement, walking. An episode is a unit;
intervals are Wilson's for shares and bootstrapped for medians. Time lost is the time until car and pedestrian are
across, less what each needs where the other is not there. Two minutes for 100 episodes.
"""

import argparse
import importlib.util
import json
import math
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vpsci_ros import Pedestrian
from vpsci_ros.evaluation.statistics import quantile, resampled, resampled_difference, share
from vpsci_ros.runs.files import atomic_write
from vpsci_ros.runs.progress import Bars
from vpsci_ros.runs.provenance import software_versions
from vpsci_ros.safety import CONFLICT_TTC, VEHICLE_LENGTH, clearance, curvature_from_yaw_rate, curvttc

EXAMPLE = Path(__file__).parents[1] / "examples" / "sumo_crossing.py"
WHO = ("our", "SUMO's")
COLOURS = {"our": "#a50f15", "SUMO's": "#08519c"}


def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("sumo_crossing", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def measured(sumo: ModuleType, rows: NDArray[np.float64]) -> dict[str, float]:
    """Return an episode's least clearance [m] and CurvTTC [s], and when car and pedestrian are across [s]; NaN: not."""
    x, y, heading, speed = rows.T[:4]
    turning = np.gradient(np.unwrap(heading), sumo.PERIOD)
    ttc = curvttc(x, y, heading, speed, curvature_from_yaw_rate(turning, speed), *rows.T[4:])
    passed = x > sumo.CROSSING[0] + 2.0 + VEHICLE_LENGTH / 2
    over = rows[:, 5] > sumo.CROSSING[1] + sumo.ROAD / 2 + 0.3
    return {
        "clearance": float(clearance(x, y, heading, *rows.T[4:6]).min()),
        "curvttc": float(ttc.min()),
        "car": float(passed.argmax() * sumo.PERIOD) if passed.any() else math.nan,
        "pedestrian": float(over.argmax() * sumo.PERIOD) if over.any() else math.nan,
    }


def played(count: int) -> tuple[list[dict[str, Any]], dict[str, NDArray[np.float64]]]:
    """Return a row an episode, and the motion of the first one in which both pedestrians and the car come near."""
    sumo, episodes = example(), list[dict[str, Any]]()
    shown: dict[str, NDArray[np.float64]] = {}
    with tempfile.TemporaryDirectory() as folder, Bars() as bars:
        net, number = sumo.network(Path(folder)), 0
        while len(episodes) < count:
            him = Pedestrian(seed=1, episode=number, scenario=sumo.SCENARIO)
            if math.hypot(*him.start[2:]) > 0.0 and him.start.y < sumo.CROSSING[1] - sumo.ROAD / 2 - 0.3:
                motion = {who: sumo.play(net, number, who) for who in (*WHO, "nobody")}
                row = {who: measured(sumo, motion[who]) for who in WHO}
                alone = measured(sumo, motion["nobody"])["car"]
                way = (sumo.CROSSING[1] + sumo.ROAD / 2 + 0.3 - him.start.y) / him.person.speed
                for who in WHO:
                    row[who] |= {"car_lost": row[who]["car"] - alone, "walker_lost": row[who]["pedestrian"] - way}
                episodes.append({"episode": number, **row})
                near = max(row[who]["curvttc"] for who in WHO) < 3.0
                shown = shown or (motion if near else {})
            number += 1
            bars.bar("episodes", len(episodes), count)
        sumo.traci.close()
    return episodes, shown


def summary(episodes: list[dict[str, Any]], who: str) -> dict[str, Any]:
    """Return what became of the episodes of one of the pedestrians, each with its interval and number."""
    rows, n = [row[who] for row in episodes], len(episodes)
    lost = {name: np.array([row[name] for row in rows]) for name in ("car_lost", "walker_lost")}
    medians = {name: resampled(values[~np.isnan(values)], quantile(0.5)) for name, values in lost.items()}
    return {
        "collision": share(sum(row["clearance"] <= 0.0 for row in rows), n),
        "conflict": share(sum(row["curvttc"] < CONFLICT_TTC for row in rows), n),
        "car_gave_way": share(sum(row["pedestrian"] < row["car"] for row in rows), n),
        "not_across": share(sum(bool(np.isnan(row["car"] + row["pedestrian"])) for row in rows), n),
        **medians,
    }


def picture(episodes: list[dict[str, Any]], shown: dict[str, NDArray[np.float64]], path: Path) -> None:
    """Draw one episode from above, and the distributions of least CurvTTC and of the walkers' time lost."""
    figure = Figure(figsize=(13, 4.2), layout="constrained")
    above, near, late = figure.subplots(1, 3, width_ratios=(1.3, 1, 1))
    for who in WHO:
        rows = shown[who][: round(12 / 0.05)]
        above.plot(*rows.T[4:6], color=COLOURS[who], label=f"{who} pedestrian, a dot a second")
        above.plot(*rows[::20].T[4:6], ".", color=COLOURS[who])
        above.plot(*rows.T[:2], "--", color=COLOURS[who], label=f"SUMO's car before {who}")
        above.plot(*rows[::20].T[:2], "|", color=COLOURS[who])
        for axes, name in ((near, "curvttc"), (late, "walker_lost")):
            values = np.sort([min(row[who][name], 10.0) for row in episodes])
            axes.step(
                values, np.arange(1, len(values) + 1) / len(values), color=COLOURS[who], label=f"{who} pedestrian"
            )
    above.set(
        title="one episode from above",
        xlabel="x [m]",
        ylabel="y [m]",
        xlim=(-106, -80),
        ylim=(-40, -20),
        aspect="equal",
    )
    near.axvline(CONFLICT_TTC, color="grey", linestyle=":")
    near.set(
        title=f"how near: {len(episodes)} episodes",
        xlabel="least CurvTTC [s], conflicts left of the line",
        ylabel="share",
    )
    late.set(title="what it costs the pedestrian", xlabel="time lost [s]", ylabel="share")
    for axes in (above, near, late):
        axes.legend(fontsize=8, loc="lower right")
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("-o", "--output", type=Path, help="JSON with all figures and episodes")
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    episodes, shown = played(given.episodes)
    found = {who: summary(episodes, who) for who in WHO}
    for name in found["our"]:
        texts = [
            f"{who} {e.value:.2f} [{e.low:.2f}, {e.high:.2f}] (n = {e.n})" for who in WHO for e in [found[who][name]]
        ]
        print(f"{name}: {', '.join(texts)}")
    for name in ("curvttc", "car_lost", "walker_lost"):
        both = np.array([[row[who][name] for who in WHO] for row in episodes]).T
        both = both[:, np.isfinite(both).all(axis=0)]
        e = resampled_difference(both[0], both[1], quantile(0.5))
        print(f"median {name}, ours less SUMO's: {e.value:.2f} [{e.low:.2f}, {e.high:.2f}] s (n = {e.n})")
    if given.output:
        whole = {"software": software_versions(), "summary": found, "episodes": episodes}
        with atomic_write(given.output) as temporary:
            temporary.write_text(json.dumps(whole, indent=1))
    if given.picture:
        picture(episodes, shown, given.picture)


if __name__ == "__main__":
    main()
