"""The table of known drivers in docs/driving_systems.md: an exam of each driver, with both timings.

    python benchmarks/ladder.py OUT [--episodes 5] [--timings own autopilot] [--drivers Blind8 Late05 ...]

What each driver is worth follows from its program: it sees nobody, or brakes later than another. Where physics leaves
no choice, the exam's order is known, and `test/exam/test_ladder.py` asserts it. Runs that are done are not driven
again. The table is printed as Markdown and written to OUT/ladder.md.
"""

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from vpsci_ros.cli.options import read_sections
from vpsci_ros.evaluation.statistics import share
from vpsci_ros.exam.conduct import timed_runs
from vpsci_ros.exam.exam import ALONE, TIMINGS, Exam, prepare, title_of
from vpsci_ros.exam.measures import arrival, episode_table
from vpsci_ros.exam.run import autopilot_run
from vpsci_ros.policy.policy_config import LEARNED
from vpsci_ros.resources import params_path

PEDESTRIANS = (LEARNED, "walker")
AUTOPILOT = "autopilot"
HALF_LENGTH, HALF_WIDTH = 2.345, 0.925  # [m] of the car
SIGHT = 3.0  # [s] ahead, in which a driver looks for pedestrians in its way
BESIDE = 1.5  # [m] beside the car, within which a pedestrian is in its way
FULL_THROTTLE, FIRMEST = 9.25, 8.0  # [m/s2]


class Blind:
    """Keeps its speed and sees nobody."""

    speed = 5.0  # [m/s]

    def reset(self, begin: Any) -> None:
        """Forget the last episode."""
        self.saw_at: float | None = None

    def act(self, observation: Any) -> Any:
        """Return the acceleration along the car [m/s2]."""
        return self.cruise(observation)

    def cruise(self, observation: Any) -> float:
        """Return the acceleration [m/s2] that brings the car to its speed."""
        return float(min(FULL_THROTTLE, max(-FIRMEST, 2.0 * (self.speed - observation.vehicle.speed))))


class Brakes(Blind):
    """Brakes for whoever is in its way, `delay` after it sees somebody there."""

    delay = 0.0  # [s]

    def act(self, observation: Any) -> Any:
        """Return the acceleration along the car [m/s2]."""
        firmest = max((braking(observation.vehicle, each) for each in observation.pedestrians), default=0.0)
        if firmest and self.saw_at is None:
            self.saw_at = observation.time
        late = self.saw_at is None or observation.time < self.saw_at + self.delay - 1e-9
        return self.cruise(observation) if late or not firmest else -firmest


def braking(car: Any, walker: Any) -> float:
    """Return the deceleration [m/s2] for a pedestrian; 0 where it does not come into the car's way."""
    cos, sin = math.cos(car.yaw), math.sin(car.yaw)
    ahead = cos * (walker.x - car.x) + sin * (walker.y - car.y) - HALF_LENGTH
    left = cos * (walker.y - car.y) - sin * (walker.x - car.x)
    aside = walker.speed * math.sin(walker.yaw - car.yaw)
    way = max(SIGHT * car.speed, 4.0)
    soon = any(abs(left + aside * 0.1 * step) < HALF_WIDTH + BESIDE for step in range(int(10.0 * SIGHT)))
    if not (soon and -HALF_LENGTH < ahead < way):
        return 0.0
    return float(min(FIRMEST, max(2.0, 0.5 * car.speed**2 / max(0.3, ahead - 1.5))))


class Polite(Blind):
    """Stops for everybody before its middle and within 12 m, wherever they go."""

    def act(self, observation: Any) -> Any:
        """Return the acceleration along the car [m/s2]."""
        car = observation.vehicle
        cos, sin = math.cos(car.yaw), math.sin(car.yaw)
        near = (each for each in observation.pedestrians if math.hypot(each.x - car.x, each.y - car.y) < 12.0)
        stops = any(cos * (each.x - car.x) + sin * (each.y - car.y) > 0.0 for each in near)
        return -4.0 if stops else self.cruise(observation)


class Swerves(Blind):
    """Keeps its speed and steers behind whoever is in its way."""

    def act(self, observation: Any) -> Any:
        """Return the accelerations along the car and to its left [m/s2]."""
        car, aside = observation.vehicle, 0.0
        for each in observation.pedestrians:
            if braking(car, each):
                aside = -math.copysign(2.5, math.sin(each.yaw - car.yaw))
        return self.cruise(observation), aside


def _driver(name: str, of: type, **values: float) -> type:
    return type(name, (of,), {"__doc__": of.__doc__, "__module__": __name__, **values})


Blind3, Blind4, Blind5, Blind6, Blind8, Blind12 = (_driver(f"Blind{v}", Blind, speed=v) for v in (3, 4, 5, 6, 8, 12))
FullThrottle = _driver("FullThrottle", Blind, speed=100.0)
Late05, Late10, Late20 = (_driver(f"Late{10 * v:02.0f}", Brakes, delay=v) for v in (0.5, 1.0, 2.0))
Faster = _driver("Faster", Brakes, speed=6.5)
Stands, Creeps = _driver("Stands", Blind, speed=0.0), _driver("Creeps", Brakes, speed=1.5)
TITLES = {
    **{f"Blind{v}": f"blind, {v} m/s" for v in (3, 4, 5, 6, 8, 12)},
    "FullThrottle": "blind, full throttle",
    "Brakes": "brakes, 5 m/s",
    "Late05": "brakes 0.5 s later",
    "Late10": "brakes 1 s later",
    "Late20": "brakes 2 s later",
    "Faster": "brakes, 30% faster",
    "Polite": "stops for everybody",
    "Swerves": "swerves",
    "Creeps": "brakes, 1.5 m/s",
    "Stands": "never moves",
}
"""Class of a driver -> its title."""


def driven(
    out: Path, driver: str, timing: str, episodes: int, pedestrians: Sequence[str] = PEDESTRIANS
) -> pl.DataFrame:
    """Return a driver's episodes on the empty road and with each pedestrian, see `vpsci_ros.exam.measures`."""
    exam = exam_of(driver, timing, episodes, pedestrians)
    folder = out / f"{timing}_{episodes}" / driver
    folder.mkdir(parents=True, exist_ok=True)
    runs, times = timed_runs(exam, folder, quiet=True)
    alone = runs[ALONE].episodes
    return pl.concat(
        episode_table(run, alone, driver="ads", pedestrian=name, timing={} if name == ALONE else times)
        for name, run in runs.items()
    )


def exam_of(driver: str, timing: str, episodes: int, pedestrians: Sequence[str] = PEDESTRIANS) -> Exam:
    """Return the exam of one driver, with so many episodes in each of eight scenarios."""
    sections = read_sections(params_path("ads_test"), [f"world_simulator.episodes={episodes}"])
    sections = sections.changed("ads_test", {"pedestrians": list(pedestrians), "timing": timing})
    return prepare(sections, ads_class=f"ladder:{driver}")


def rule_based(episodes: int) -> pl.DataFrame:
    """Return the rule-based autopilot's episodes, for which episodes are drawn."""
    exam = exam_of("Blind5", "autopilot", episodes)
    alone = autopilot_run(exam, ALONE).episodes
    runs = {name: autopilot_run(exam, name) for name in PEDESTRIANS}
    tables = [episode_table(run, alone, driver="ads", pedestrian=name) for name, run in runs.items()]
    away = pl.DataFrame({"pedestrian": [ALONE] * len(alone), "arrived": [arrival(each) is not None for each in alone]})
    return pl.concat([*tables, away], how="diagonal")


def _mean(values: pl.Series) -> float:
    return float(values.to_numpy().mean())


def row(title: str, timing: str, pedestrian: str, table: pl.DataFrame) -> str:
    """Return one row of the table."""
    rows, alone = table.filter(pedestrian=pedestrian), table.filter(pedestrian=ALONE)
    moving, lost = rows.filter("moving_collision"), rows["time_lost"].drop_nans()
    standing = rows.filter(pl.col("collision") & ~pl.col("moving_collision")).height
    hit = share(moving.height, rows.height)
    cells = [
        title, timing, title_of(pedestrian).split(",")[0], rows.height, f"{100 * _mean(rows['critical']):.0f}%",
        f"{100 * hit.value:.0f}% [{100 * hit.low:.0f}, {100 * hit.high:.0f}]",
        f"{_mean(moving['impact_speed']):.1f}" if moving.height else "-", f"{100 * standing / rows.height:.0f}%",
        f"{100 * _mean(rows['arrived']):.0f}%", f"{_mean(lost):.1f}" if len(lost) else "-",
        "" if alone["arrived"].all() else "fails: does not arrive on the empty road",
    ]  # fmt: skip
    return f"| {' | '.join(str(cell) for cell in cells)} |"


def lines(out: Path, drivers: list[str], timings: list[str], episodes: int) -> Iterator[str]:
    """Yield the lines of the table."""
    heads = ("driver", "timed to", "pedestrian", "n", "critical", "hit, car moving", "at [m/s]", "walked into it",
             "arrived", "time lost [s]", "verdict")  # fmt: skip
    yield from (f"| {' | '.join(heads)} |", "|---" * len(heads) + "|")
    reference = rule_based(episodes)
    for pedestrian in PEDESTRIANS:
        yield row("rule-based autopilot", AUTOPILOT, pedestrian, reference)
        for driver in drivers:
            for timing in timings:
                yield row(TITLES[driver], timing, pedestrian, driven(out, driver, timing, episodes))


def main() -> None:
    """Drive what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--episodes", type=int, default=5, help="in each of eight scenarios")
    parser.add_argument("--timings", nargs="+", default=list(TIMINGS), choices=TIMINGS)
    parser.add_argument("--drivers", nargs="+", default=list(TITLES), choices=list(TITLES))
    given = parser.parse_args()
    sys.path.insert(0, str(Path(__file__).resolve().parent))
    found = []
    for line in lines(given.out, given.drivers, given.timings, given.episodes):
        print(line, flush=True)
        found.append(line)
    (given.out / "ladder.md").write_text("\n".join(found) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
