"""A car that never brakes on a straight road: how often it touches the default pedestrian, and one who walks on.

    python benchmarks/straight_road.py [--episodes 200] [--speeds 2 5 8] [--leads -1 0 1]
    python benchmarks/straight_road.py --engines sumo highway [--episodes 100]
    python benchmarks/straight_road.py --engines commonroad --scenarios FOLDER

A pedestrian crosses the road at 1.3 m/s from 5 m before its middle; a car comes along the middle at constant speed, so
that both would be at the crossing point at the same time (lead 0 s), or the car so much later (negative: earlier). The
walker who does not react draws nothing, so one episode says it all. Counted are contacts of the footprints, the least
clearance, whether the pedestrian was past the middle when the car came, and which hand-overs lay beyond the range of
the recorded onsets. Wilson's 95% intervals, an episode a unit.

With `--engines`, only the last of these, in the examples of other engines: `examples/sumo_crossing.py` (extra sumo),
where SUMO's car gives way, `examples/highway_crossing.py` (extra highway), and `examples/commonroad_crossing.py`
(`make setup` puts its packages into .venv/commonroad) in each scenario of a folder that `vpsci export --to commonroad`
wrote.
"""

import argparse
import importlib.util
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from vpsci_ros import Pedestrian, Vehicle, Walker
from vpsci_ros.evaluation.statistics import wilson_interval
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.runs.progress import Bars
from vpsci_ros.safety import clearance

TICK, PACE, BEFORE, SECONDS = 0.05, 1.3, 5.0, 9.0  # [s], [m/s], [m] before the middle, [s]


class Crossing(NamedTuple):
    """What came of an episode.

    clearance [m]: the least; first: the pedestrian was past the middle when the car was; beyond: the hand-over lay
    beyond the range of the recorded onsets, None: there was none, or no bank acts.
    """

    clearance: float
    first: bool
    beyond: bool | None = None


def crossed(pedestrian: Pedestrian | None, speed: float, lead: float) -> Crossing:
    """Return what came of an episode; without a pedestrian's object, of one who walks on."""
    me = Walker(0.0, -BEFORE, 0.0, PACE)
    x = -speed * (BEFORE / PACE + lead)
    near, first = np.inf, False
    for _ in range(round(SECONDS / TICK)):
        if pedestrian is None:
            me = me._replace(y=me.y + PACE * TICK)
        else:
            me = Walker(*pedestrian.step(me, {"car": Vehicle(x, 0.0, 0.0, speed, 0.0, 0.0)}, period=TICK)[:4])
        if x < 0.0 <= x + speed * TICK:
            first = me.y > 0.0
        x += speed * TICK
        near = min(near, float(clearance(x, 0.0, 0.0, me.x, me.y)))
        if x > 8.0:
            break
    return Crossing(near, first, None if pedestrian is None else pedestrian.person.beyond)


def handed_over(engine: str, count: int, scenarios: list[Path]) -> list[bool]:
    """Return for each hand-over in episodes of an engine's example whether it lay beyond the range.

    :param count: of episodes in SUMO and highway-env; CommonRoad has one in each of `scenarios`.
    """
    example = _example(f"{engine}_crossing")
    made: list[Pedestrian] = []

    class Kept(Pedestrian):
        """A pedestrian that is asked after its episode."""

        def __init__(self, *given: Any, **named: Any) -> None:
            super().__init__(*given, **named)
            made.append(self)

    vars(example)["Pedestrian"] = Kept
    with tempfile.TemporaryDirectory() as folder:
        if engine == "sumo":
            net = example.network(Path(folder))
            for episode in range(count):
                example.play(net, episode, "our")
            example.traci.close()
        elif engine == "commonroad":
            with Bars() as bars:
                for done, path in enumerate(scenarios):
                    bars.bar("scenarios", done, len(scenarios))
                    example.play(str(path), reacts=True)
        else:
            for episode in range(count):
                example.play(episode)
    found = [person.person.beyond for person in made]
    return [each for each in found if each is not None]


def _example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, Path(__file__).parents[1] / "examples" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _share(held: list[bool]) -> str:
    low, high = wilson_interval(sum(held), len(held))
    return f"{sum(held)} of {len(held)} [{low:.0%}, {high:.0%}]"


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--speeds", type=float, nargs="+", default=[2.0, 5.0, 8.0], help="[m/s]")
    parser.add_argument("--leads", type=float, nargs="+", default=[-1.0, 0.0, 1.0], help="[s]")
    parser.add_argument("--weights", default="people")
    parser.add_argument(
        "--engines", nargs="+", choices=("sumo", "highway", "commonroad"), help="measure the examples of these engines"
    )
    parser.add_argument("--scenarios", type=Path, metavar="FOLDER", help="of CommonRoad's .xml files")
    given = parser.parse_args()
    scenarios = sorted(given.scenarios.glob("*.xml")) if given.scenarios else []
    if "commonroad" in (given.engines or ()) and not scenarios:
        parser.error(f"--scenarios {given.scenarios}: expected a folder with .xml files for --engines commonroad")
    for engine in given.engines or ():
        held = handed_over(engine, given.episodes, scenarios)
        count = len(scenarios) if engine == "commonroad" else given.episodes
        print(f"{engine}: {_share(held)} hand-overs of {count} episodes beyond the range", flush=True)
    if given.engines:
        return
    weights, way = load_policy(given.weights), [(0.0, -8.0), (0.0, 8.0)]
    heads = ("car [m/s]", "lead [s]", "walks on", "learned: contact", "clearance, median", "is past first", "beyond")
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for speed in given.speeds:
        for lead in given.leads:
            alone = crossed(None, speed, lead).clearance
            people = (Pedestrian(weights, seed=1, episode=k, route=way, speed=PACE) for k in range(given.episodes))
            found = [crossed(person, speed, lead) for person in people]
            hit, past = _share([each.clearance <= 0.0 for each in found]), _share([each.first for each in found])
            median = np.median([each.clearance for each in found])
            walks = "contact" if alone <= 0.0 else f"{alone:.1f} m"
            handed = [each.beyond for each in found if each.beyond is not None]
            beyond = _share(handed) if handed else "no hand-over"
            print(f"| {speed:g} | {lead:+g} | {walks} | {hit} | {median:.2f} m | {past} | {beyond} |", flush=True)


if __name__ == "__main__":
    main()
