"""How scenes begin: onsets of the world beside recorded ones, and the numbers that `world.calibration` draws from.

    python benchmarks/onsets.py near_misses.parquet [--episodes 60] [--spawn human paper] [--weights closed_loop]
                                     [--seed 7] [--picture docs/onsets.png]
    python benchmarks/onsets.py right_turns/train --spawn right_turns --rows vpsci_ros/recordings/onsets.csv

The onset is the first step of 0.1 s with CurvTTC, as known then, below 5 s. Recorded: near misses whose car moves and
whose track has half a second before it; whole clips are resampled for intervals, and left out by the classifier's
folds. Generated: every critical episode, rejected ones, too. Two minutes.
"""

import argparse
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vpsci_ros.data.courses import trailing_slope
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.data.recorded import size_of
from vpsci_ros.evaluation.onsets import STEPS, find_onsets
from vpsci_ros.evaluation.statistics import Units, cluster_counts, interval, quantile, resampled, share, units_of
from vpsci_ros.extras.paper.realism.long_run import SETS_OFF, STANDS
from vpsci_ros.extras.paper.realism.two_sample import two_sample
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.safety import CRITICAL_TTC, VEHICLE_LENGTH, VEHICLE_WIDTH, curvature_from_yaw_rate
from vpsci_ros.safety import PEDESTRIAN_RADIUS as RADIUS
from vpsci_ros.world import World, WorldConfig, calibration, load_scenarios
from vpsci_ros.world.kinematics import curvature_of
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.observation import STEP

Floats = NDArray[np.float64]
TRACK = ("veh_x", "veh_y", "veh_heading", "veh_speed", "ped_x", "ped_y", "ped_vx", "ped_vy")
STATE: tuple[str, ...] = ("vehicle_x", "vehicle_y", "vehicle_heading", "vehicle_speed")
STATE += ("pedestrian_x", "pedestrian_y", "pedestrian_vx", "pedestrian_vy", "controlled", "episode", "scenario")
SECOND, LEAST = 10, 5  # steps over which accelerations are measured, as many as there are; fewest that there must be
GAIN = 0.5  # [m/s]
MOTION = ["car_speed", "car_acceleration", "walking_speed", "walking_acceleration", "distance", "curvttc"]
SHARPEST = curvature_of(1.0)  # [1/m]
PLACE = [*MOTION, "ahead", "aside", "walk_along", "walk_across"]
SETS = {"motion": MOTION, "motion and place": PLACE, "and turn rates": [*PLACE, "yaw_rate", "walk_turn"]}


def onset_of(track: Floats, ttc: Floats, size: tuple[float, float]) -> dict[str, float] | None:
    """Return what the onset of a track float64[T, 8] (`TRACK`) is like; None where none is seen half a second before.

    Scenes are mirrored so that the walker is to the car's left. `oblique` [degrees] is the walker's direction from
    straight towards the car's path, positive along with the car; `miss` says by how much the two will miss each other,
    from 0 to 1 where they will graze, NaN where the walker does not cross.

    :param size: length and width of the car [m].
    """
    x, y, heading, speed, px, py, vx, vy = track.T
    critical = np.flatnonzero(ttc < CRITICAL_TTC)
    if len(critical) == 0 or critical[0] < LEAST:
        return None
    k = int(critical[0])
    begin = max(0, k - SECOND)
    pace, heading = np.hypot(vx, vy), np.unwrap(heading)
    course = np.unwrap(np.arctan2(vy, vx))
    c, s = np.cos(heading[k]), np.sin(heading[k])
    ahead, left = (px[k] - x[k]) * c + (py[k] - y[k]) * s, (py[k] - y[k]) * c - (px[k] - x[k]) * s
    side = 1.0 if left >= 0.0 else -1.0
    before = slice(max(0, k - 2 * SECOND), k + 1)

    along, across = vx[k] * c + vy[k] * s, side * (vy[k] * c - vx[k] * s)
    oblique, miss = float(np.degrees(np.arctan2(along, -across))), np.nan
    if abs(oblique) < 45.0 and speed[k] > 0.0 and across < 0.0:
        walks, room = side * left / -across, (0.5 * size[0] + RADIUS) / speed[k] + (0.5 * size[1] + RADIUS) / -across
        miss = abs(walks - (ahead + along * walks) / speed[k]) / room

    def rate(values: Floats) -> float:
        return float((values[k] - values[begin]) / ((k - begin) * STEP))

    return {
        "car_speed": speed[k],
        "car_acceleration": rate(speed),
        "walking_speed": pace[k],
        "walking_acceleration": rate(pace),
        "distance": float(np.hypot(ahead, left)),
        "curvttc": ttc[k],
        "ahead": ahead,
        "aside": side * left,
        "walk_along": along,
        "walk_across": across,
        "oblique": oblique if abs(oblique) < 45.0 else np.nan,
        "miss": miss,
        "yaw_rate": side * rate(heading),
        "walk_turn": rate(course) if pace[before].min() > 0.2 else 0.0,
        "slowest_walk": pace[before].min(),
        "time_critical": STEP * float(np.sum(ttc < CRITICAL_TTC)),
        "top_speed": speed.max(),
        "acceleration_after": float(np.max(np.diff(speed[k:]), initial=-np.inf)) / STEP,
    }


def with_onset(table: pl.DataFrame) -> pl.DataFrame:
    """Return the interactions whose vehicle drives and whose onset was seen, also those whose paths stay apart."""
    return table.filter(~pl.col("standing") & ~pl.col("begins_critical"))


def recorded(table: pl.DataFrame) -> pl.DataFrame:
    """Return a row an onset, with its `clip` and `group`."""
    rows = []
    for part in with_onset(table).partition_by("interaction", maintain_order=True):
        size = size_of(part)
        onset = onset_of(part.select(TRACK).to_numpy(), part["curvttc_causal"].to_numpy(), size)
        if onset is not None:
            clip, group = f"{part['source'][0]}/{part['clip'][0]}", part["group"][0]
            rows.append(onset | {"clip": clip, "group": group})
    return pl.DataFrame(rows)


def rows_of(table: pl.DataFrame) -> Floats:
    """Return `calibration.right_turns` of a near-miss table: clean onsets with 0.5 s before and 3 s after them."""
    onsets = find_onsets(with_onset(table), history=LEAST)
    out = np.zeros((len(onsets), calibration.TRACK + calibration.COLUMNS * (SECOND + 1)))
    for row, motion, first, ttc in zip(
        out, onsets.interactions.motion, onsets.interactions.first, onsets.interactions.curvttc, strict=True
    ):
        before = min(SECOND, int(first))
        begin, after = first - before, motion[first : first + STEPS + 1]
        heading = np.unwrap(motion[: first + STEPS + 1, 2])
        speed = np.hypot(motion[: first + 1, 3], motion[: first + 1, 4])
        curvature = curvature_from_yaw_rate(trailing_slope(heading[: first + 1]), speed)
        cosine, sine = np.cos(heading[first]), np.sin(heading[first])
        to_car = np.array([[cosine, sine], [-sine, cosine]])
        row[calibration.BEFORE], row[calibration.TTC] = before, ttc[first]
        row[[calibration.AHEAD, calibration.LEFT]] = to_car @ (motion[first, 5:7] - motion[first, 0:2])
        row[calibration.TURNS] = heading[first + STEPS] - heading[first]
        row[calibration.WAY] = np.hypot(*np.diff(after[:, :2], axis=0).T).sum()
        walk = motion[begin : first + 1, 7:9] @ to_car.T
        track = np.column_stack([speed[begin:], np.clip(curvature[begin:], -SHARPEST, SHARPEST), walk])
        row[calibration.TRACK :] = np.concatenate([track[:1].repeat(SECOND - before, axis=0), track]).ravel()
    return out


def generated(config: WorldConfig, episodes: int, weights: str, seed: int) -> tuple[pl.DataFrame, dict[str, float]]:
    """Return a row an onset of so many episodes a scenario, with its `clip` (itself), and shares of all of them."""
    queue = [(scenario, number) for number in range(episodes) for scenario in range(1, 9)]
    world = World(config, load_scenarios(range(1, 9)), queue, 512, seed)
    seen: dict[tuple[int, int], list[tuple[float, ...]]] = {}
    accelerations: dict[tuple[int, int], list[tuple[float, ...]]] = {}
    for step in Loop(world, agents=policies(load_policy(weights), world)):
        state = step.tick.state
        for i in np.flatnonzero(state["status"]):
            row = state[i]
            key = int(row["scenario"]), int(row["episode"])
            accelerations.setdefault(key, []).append((*(float(row[name]) for name in _MOVES),))
            if row["frame"] % 2 == 0:
                values = (float(row[name]) for name in STATE[:8])
                seen.setdefault(key, []).append((*values, float(step.assessment.curvttc[i])))
    rows, critical = [], 0
    for (scenario, number), track in seen.items():
        motion = np.array(track)
        critical += bool((motion[:, 8] < CRITICAL_TTC).any())
        onset = onset_of(motion[:, :8], motion[:, 8], (VEHICLE_LENGTH, VEHICLE_WIDTH))
        if onset is not None:
            jumps = _jumps(np.array(accelerations[scenario, number]))
            rows.append(onset | jumps | {"clip": f"{scenario}:{number}"})
    return pl.DataFrame(rows), {"critical": critical / len(queue), "episodes": len(queue)}


_MOVES = ("vehicle_speed", "pedestrian_vx", "pedestrian_vy", "controlled")


def _jumps(moves: Floats) -> dict[str, float]:
    """Return by how much each acceleration [m/s2], means over 0.1 s, changes where the policies first take over."""
    taken = np.flatnonzero(np.diff(moves[:, 3]) == 1.0)
    if len(taken) == 0 or taken[0] < 2 or taken[0] + 2 >= len(moves):
        return {"car_jump": np.nan, "walk_jump": np.nan}
    k = int(taken[0])
    change = (moves[k + 2] - 2.0 * moves[k] + moves[k - 2]) / STEP
    return {"car_jump": abs(change[0]), "walk_jump": float(np.hypot(*change[1:3]))}


def units(table: pl.DataFrame) -> Units:
    """Return what intervals of recorded onsets resample: clips, or groups where there are few clips."""
    return units_of(table["clip"].to_numpy(), table["group"].to_numpy())


def fit(name: str, table: pl.DataFrame) -> None:
    """Print the quantiles that `world.calibration` has, with 95% intervals of `units`."""
    table = table.with_columns(unit=units(table).labels)
    print(f"{name}: {table.height} onsets of {units(table).text}; quantiles at {calibration.SHARES[1:-1]}")
    for column in (*MOTION[:4], "oblique", "miss"):
        known = table.filter(pl.col(column).is_not_nan())
        values, counts = known[column].to_numpy(), cluster_counts(known["unit"].to_numpy(), 0)
        order = np.argsort(values)
        drawn = np.cumsum(counts[:, order], axis=1)
        parts = []
        for q in calibration.SHARES[1:-1]:
            low, high = interval(values[order][(drawn >= q * drawn[:, -1:]).argmax(axis=1)])
            parts.append(f"{np.quantile(values, q):.2f} [{low:.2f}, {high:.2f}]")
        print(f"  {column} ({known.height}): " + ", ".join(parts))


def speeding_up(table: pl.DataFrame) -> tuple[Floats, Floats]:
    """Return the strongest acceleration over half a second [m/s2] of drivers and of walkers who speed up.

    Drivers who gain 0.5 m/s or more after the last critical step, and walkers who stood below 0.3 m/s after the first
    and came to 0.8 m/s then.
    """
    drivers, walkers = [], []
    for part in table.partition_by("interaction", maintain_order=True):
        critical = np.flatnonzero(part["curvttc_causal"].to_numpy() < CRITICAL_TTC)
        speed, pace = part["veh_speed"].to_numpy(), np.hypot(part["ped_vx"].to_numpy(), part["ped_vy"].to_numpy())
        if len(critical):
            on, pace = speed[critical[-1] :], pace[critical[0] :]
            again = pace[(pace < STANDS).argmax() :] if (pace < STANDS).any() else pace[:0]
            drivers += [strongest(on)] if len(on) > LEAST and on.max() - on[0] >= GAIN else []
            walkers += [strongest(again)] if len(again) > LEAST and again.max() > SETS_OFF else []
    return np.array(drivers), np.array(walkers)


def strongest(speed: Floats) -> float:
    """Return the strongest mean acceleration [m/s2] over half a second of speeds float64[T], T > 5."""
    return float((speed[LEAST:] - speed[:-LEAST]).max() / (LEAST * STEP))


def compare(name: str, mine: pl.DataFrame, real: pl.DataFrame, shares: dict[str, float], seed: int) -> None:
    """Print the table of targets of one spawn."""
    print(f"{name}: {shares['critical']:.1%} of {shares['episodes']:.0f} episodes critical, {mine.height} onsets")
    for what, part in _SHARES.items():
        values = [share(int(table.filter(part).height), table.height) for table in (mine, real)]
        print(f"  {what}: " + " against ".join(f"{v.value:.1%} [{v.low:.1%}, {v.high:.1%}]" for v in values))
    for what, column, q in _QUANTILES:
        quantiles = [resampled(t[column].to_numpy(), quantile(q)) for t in (mine, real)]
        print(f"  {what}: " + " against ".join(f"{v.value:.2f} [{v.low:.2f}, {v.high:.2f}]" for v in quantiles))
    for agent in ("car", "walk"):
        jumps = mine[f"{agent}_jump"].drop_nans().to_numpy()
        found = share(int((jumps > 1.0).sum()), len(jumps))
        print(f"  {agent} jump > 1 m/s2 at the hand-over: {found.value:.1%} [{found.low:.1%}, {found.high:.1%}]")
    held = units(real).labels, mine["clip"].to_numpy().astype(str)
    for what, columns in SETS.items():
        sides = {c: real[c].to_numpy() for c in columns}, {c: mine[c].to_numpy()[:, None] for c in columns}
        test = two_sample(sides[0], [sides[1]], held, seed, paired=False)
        low, high = test.auc_interval
        print(f"  C2ST of the onset, {what}: {test.auc:.2f} [{low:.2f}, {high:.2f}]")


_SHARES = {
    "stood less than 2 s before": pl.col("slowest_walk") < 0.3,
    "pedestrian > 2 m/s": pl.col("walking_speed") > 2.0,
    "vehicle > 3 m/s": pl.col("car_speed") > 3.0,
}
_QUANTILES = [
    ("CurvTTC at the onset, median [s]", "curvttc", 0.5),
    ("time critical, median [s]", "time_critical", 0.5),
    ("vehicle's acceleration after it, 95% [m/s2]", "acceleration_after", 0.95),
    ("vehicle's top speed, 95% [m/s]", "top_speed", 0.95),
]


def draw(sides: dict[str, pl.DataFrame], path: Path) -> None:
    """Draw distributions and places of onsets."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(11, 6.2), constrained_layout=True)
    colours = dict(zip(sides, ("#1b1b1b", "#2a78b8", "#d2752c"), strict=False))
    panels = [("car_speed", "vehicle's speed [m/s]", (0, 6)), ("walking_speed", "pedestrian's speed [m/s]", (0, 4)),
              ("car_acceleration", "vehicle's acceleration [m/s2]", (-2, 2.5)),
              ("walking_acceleration", "pedestrian's acceleration [m/s2]", (-2, 2.6)),
              ("curvttc", "CurvTTC at the onset [s]", (0, 5))]  # fmt: skip
    for axis, (column, label, limits) in zip(axes.flat, panels, strict=False):
        for name, table in sides.items():
            values = np.sort(table[column].to_numpy())
            axis.plot(values, (np.arange(len(values)) + 0.5) / len(values), color=colours[name], label=name)
        axis.set(xlabel=label, ylabel="share below", xlim=limits, ylim=(0, 1))
    axes[0, 0].legend(frameon=False)
    for name, table in list(sides.items())[::-1]:
        sample = table.sample(min(180, table.height), seed=1)
        axes[1, 2].scatter(sample["aside"], sample["ahead"], s=8, color=colours[name], alpha=0.6, linewidths=0)
    axes[1, 2].set(xlabel="pedestrian to the side [m]", ylabel="ahead of the vehicle [m]", xlim=(0, 14), ylim=(-5, 32))
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("near_misses", type=Path, help="table of whole tracks, of `vpsci import`")
    parser.add_argument("--episodes", type=int, default=60, help="in each scenario")
    parser.add_argument("--spawn", nargs="+", default=["human", "paper"], help="what is compared")
    parser.add_argument("--weights", default="people", help="file or shipped name: who acts from the onset on")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--picture", type=Path)
    parser.add_argument(
        "--rows", type=Path, help="write the recorded onsets, the rows of calibration.right_turns, as CSV"
    )
    arguments = parser.parse_args()
    table = read_near_misses(arguments.near_misses)
    real = recorded(table)
    fit("recorded", real)
    for who, values in zip(("drivers", "walkers"), speeding_up(table), strict=True):
        print(f"  {who} who speed up ({len(values)}): {np.quantile(values, calibration.SHARES).round(2).tolist()} m/s2")
    if arguments.rows:
        header = (
            "Onsets of recorded right turns: the training part of right_turns.parquet (CQUT-PVI, MIT licence), by\n"
        )
        header += "python benchmarks/onsets.py right_turns/train --rows; columns of calibration.right_turns"
        np.savetxt(arguments.rows, rows_of(table), "%.4g", ",", header=header)
    sides = {"recorded": real}
    for spawn in arguments.spawn:
        config = WorldConfig(spawn=spawn, episode_time=10.0 if spawn == "paper" else WorldConfig().episode_time)
        mine, shares = generated(config, arguments.episodes, arguments.weights, arguments.seed)
        fit(spawn, mine)
        compare(spawn, mine, real, shares, arguments.seed)
        sides[f"generated, {spawn}"] = mine
    if arguments.picture:
        draw(sides, arguments.picture)


if __name__ == "__main__":
    main()
