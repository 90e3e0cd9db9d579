"""Euro NCAP's tests: where a car at constant speed hits the target, what cells are worth, and how they are driven."""

import json
import math
import sys
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from class_in_process import class_in_process

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.data.episode import Episode
from vpsci_ros.data.episode_block import ended_episodes
from vpsci_ros.exam.exam import prepare
from vpsci_ros.extras.exam_extra import euro_ncap
from vpsci_ros.extras.exam_extra.euro_ncap import KMH, Cell, cells, colour_of, document, impact_speed, motion, rated
from vpsci_ros.extras.exam_extra.protocol import beside_people, run_protocol
from vpsci_ros.resources import params_dir
from vpsci_ros.runs.workers import ThisMachine
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, clearance
from vpsci_ros.world import Recorded, World, WorldConfig
from vpsci_ros.world.parked import in_sight, parked_from
from vpsci_ros.world.scenario import scenario_from
from vpsci_ros.world.tick import Actions

CONFIG = WorldConfig(
    spawn="paper", vehicle_driver="external", pedestrian_driver="replay", episode_time=euro_ncap.EPISODE_TIME
)
SCENARIOS = [scenario_from(document(cell), cell.name) for cell in cells()]


@lru_cache
def driven(braking: float) -> dict[int, Episode]:
    """Return each cell's episode, by its number, of a car that is commanded this acceleration all the time."""
    keys = [(scenario.number, 0) for scenario in SCENARIOS]
    targets = Recorded({key: (np.zeros((len(rows), 5)), rows) for key, rows in motion(SCENARIOS, CONFIG).items()})
    world = World(CONFIG, SCENARIOS, keys, len(keys), 1, targets)
    commands, nothing = Actions(vehicle=np.tile([braking, 0.0], (len(keys), 1))), np.full(len(keys), np.inf)

    def ticks() -> Any:
        while not world.done:
            state = world.state.copy()
            world.advance(world.now.unassessed(), commands)
            yield SimpleNamespace(state=state, curvttc=nothing, distance=nothing)

    return {episode.key[0]: episode for episode in ended_episodes(ticks(), CONFIG.tick, SCENARIOS)}


@pytest.mark.parametrize("cell", cells(), ids=lambda cell: cell.name)
def test_at_constant_speed_the_front_hits_the_target_at_the_stated_share_of_the_width(cell: Cell) -> None:
    """Between the frames before and after the contact everybody moves on straight, so the contact is found there."""
    seen = driven(0.0)[cell.number]
    free = clearance(seen.x, seen.y, seen.heading, seen.ped_x[0], seen.ped_y[0])
    k = int(np.flatnonzero(free <= 0.0)[0])
    parts = np.linspace(0.0, 1.0, 20_001)
    track = (seen.x, seen.y, seen.heading, seen.ped_x[0], seen.ped_y[0])
    x, y, heading, px, py = (each[k - 1] + parts * (each[k] - each[k - 1]) for each in track)
    first = int(np.flatnonzero(clearance(x, y, heading, px, py) <= 0.0)[0])
    dx, dy, cos, sin = px[first] - x[first], py[first] - y[first], math.cos(heading[first]), math.sin(heading[first])
    assert cos * dx + sin * dy == pytest.approx(0.5 * VEHICLE_LENGTH + PEDESTRIAN_RADIUS, abs=1e-3)
    from_right_edge = 0.5 * VEHICLE_WIDTH + cos * dy - sin * dx
    assert from_right_edge == pytest.approx(cell.location / 100.0 * VEHICLE_WIDTH, abs=1e-3)
    assert seen.speed[k - 1] == cell.speed * KMH
    assert impact_speed(seen) == pytest.approx(cell.speed)


def test_the_target_walks_at_the_protocols_speed_and_stands_before() -> None:
    for cell in cells():
        walk = motion([SCENARIOS[cell.number - euro_ncap.FIRST_NUMBER]], CONFIG)[cell.number, 0]
        speed = np.hypot(walk[:, 2], walk[:, 3])
        assert speed[0] == 0.0
        assert speed[-1] == pytest.approx(cell.spec.target * KMH)
        assert np.diff(walk[:, :2], axis=0) == pytest.approx(0.5 * (walk[1:, 2:] + walk[:-1, 2:]) * 0.05, abs=2e-3)


def test_a_turn_is_90_degrees_with_the_protocols_radius_at_its_tightest() -> None:
    for cell in cells():
        if cell.spec.turn is None:
            continue
        path = SCENARIOS[cell.number - euro_ncap.FIRST_NUMBER].vehicle.path
        side = 1.0 if cell.spec.left else -1.0
        assert path.heading(path.length - 1.0) == pytest.approx(side * math.pi / 2.0, abs=2e-3)
        assert 1.0 / np.abs(path.curvature()).max() == pytest.approx(cell.spec.turn[cell.speed][0], rel=0.02)


def test_parked_vehicles_hide_the_child_until_it_steps_out() -> None:
    for cell in cells():
        if not cell.spec.obstructed:
            continue
        scenario = SCENARIOS[cell.number - euro_ncap.FIRST_NUMBER]
        walk = motion([scenario], CONFIG)[cell.number, 0]
        target = Recorded({(cell.number, 0): (np.zeros((len(walk), 5)), walk)})
        world = World(CONFIG, [scenario], [(cell.number, 0)], 1, 1, target)
        seen = []
        while world.state["status"][0] == 1:
            seen.append(bool(in_sight(world.state, parked_from([scenario]))[0]))
            world.advance(world.now.unassessed(), Actions(vehicle=np.zeros((1, 2))))
        assert not seen[0]
        assert seen[-1]


@pytest.mark.parametrize(
    ("speed", "impact", "colour"),
    [(10, 0.0, "green"), (20, 0.5, "red"), (30, 10.0, "brown"), (30, 10.1, "red"), (40, 10.0, "orange"),
     (40, 20.0, "brown"), (50, 10.0, "yellow"), (60, 20.0, "orange"), (60, 30.0, "brown"), (60, 30.1, "red")],
)  # fmt: skip
def test_a_crossing_cell_has_the_colour_of_its_impact_speed(speed: int, impact: float, colour: str) -> None:
    assert colour_of(Cell(0, "CPNA", speed, 50), impact) == colour


def test_in_a_turn_only_avoidance_counts() -> None:
    assert [colour_of(Cell(0, "CPTAfs", 20, 50), speed) for speed in (0.0, 0.1)] == ["green", "red"]


def test_the_points_are_the_mean_of_the_cells_rounded_to_hundredths() -> None:
    """CPNA: 18 cells, of which one of 60 km/h at 25 km/h (brown), 0.5 x 17.25 / 18 = 0.479; CPTA: 3 of 4 cells."""
    speeds = dict.fromkeys((cell.number for cell in cells()), 0.0)
    named = {cell.name: cell.number for cell in cells()}
    found = rated(speeds | {named["CPNA-50_60kmh"]: 25.0, named["CPTAns-50_10kmh"]: 1.0})
    assert found["tests"]["CPNA"]["points"] == 0.48
    assert found["tests"]["CPTAfs & CPTAns"]["points"] == 0.75
    assert (found["points"], found["of"], found["passed"]) == (3.73, 4.0, False)


def test_an_ideal_brake_gets_full_points_and_one_that_never_brakes_none() -> None:
    ideal, never = (rated({n: impact_speed(each) for n, each in driven(a).items()}) for a in (-8.88, 0.0))
    assert (ideal["points"], ideal["passed"], ideal["unmet"]) == (4.0, True, [])
    assert (never["points"], never["passed"]) == (0.0, False)
    assert never["unmet"] == ["CPNA-75_10kmh", "slow-75_20kmh"]
    assert all(row["colour"] == "red" for test in never["tests"].values() for row in test["cells"])


def test_without_slowing_for_a_slow_pedestrian_nothing_counts() -> None:
    speeds = dict.fromkeys((cell.number for cell in cells()), 0.0)
    slow = next(cell.number for cell in cells() if cell.test == "slow")
    assert rated(speeds | {slow: 20.0})["points"] == 0.0
    assert rated(speeds | {slow: 12.0})["points"] == 4.0


def test_a_test_names_the_values_that_stand_in_drawings_alone() -> None:
    found = rated(dict.fromkeys((cell.number for cell in cells()), 0.0))["tests"]
    assert found["CPNCO"]["drawn"] == [
        "colours of the speeds at the impact",
        "impact locations of the standard range",
        "target stands 4 m from the impact and speeds up over 1 m",
        "gaps of 1 m at the parked vehicles",
    ]
    assert "target's path 9.5 m from the middle of the vehicle's road" in found["CPTAfo & CPTAno"]["drawn"]


def test_an_incomplete_run_has_no_points_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    chosen = [cell for cell in cells() if cell.name in ("CPNA-75_10kmh", "CPTAns-50_10kmh")]
    monkeypatch.setattr(euro_ncap, "cells", lambda: chosen)
    (tmp_path / "half.py").write_text(
        "class Half:\n"
        "  def reset(self, begin):\n"
        "    assert not begin.scenario.name.startswith('CPTA')\n"
        "  def act(self, observation): return -8.0\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    sections = load(params_dir() / "ads_test.yaml").changed("ads_test", {"baseline": False})
    with class_in_process():
        reasons = run_protocol(
            prepare(sections, ads_class="half:Half"), tmp_path / "out", None, 1.0, workers=ThisMachine(), quiet=True
        )
    none = "no points, since 1 cell was not driven: CPTAns-50_10kmh"
    assert reasons[1:] == [none]
    said = capsys.readouterr().out
    assert f"the ADS: {none}\nFAILED" in said
    assert " of 1.5 points" not in said
    assert json.loads((tmp_path / "out" / "report.json").read_text())["drivers"]["ads"]["points"] is None
    assert none in " ".join((tmp_path / "out" / "report.html").read_text().split())


def test_who_passes_the_protocol_and_hits_one_pedestrian_of_several_is_named_with_that_one() -> None:
    scores = {name: {"moving_collision_rate": {"value": rate}} for name, rate in (("learned", 0.0), ("walker", 0.1))}
    rows = beside_people({"drivers": {"ads": {"points": 4.0, "of": 4.0, "passed": True}}}, {"ads": scores})
    assert [(row["pedestrian"], row["says"]) for row in rows] == [
        ("learned", "passes the protocol, and hits nobody here"),
        ("walker", "passes the protocol and fails with people"),
    ]


def test_the_protocol_has_a_report_with_the_pedestrians_of_an_exam_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = ("CPNA-75_10kmh", "CPNCO-50_30kmh", "CPTAns-50_10kmh", "slow-75_20kmh")
    chosen = [cell for cell in cells() if cell.name in wanted]
    monkeypatch.setattr(euro_ncap, "cells", lambda: chosen)
    people = {
        "drivers": {"ads": {"walker": {"moving_collision_rate": {"value": 0.1, "low": 0.0, "high": 0.2, "n": 10}}}}
    }
    (tmp_path / "report.json").write_text(json.dumps(people | {"exam": {"ads": "mine"}}))
    exam = prepare(load(params_dir() / "ads_test.yaml"), ads_class="vpsci_ros.nodes.example_driver:ExampleDriver")
    out = tmp_path / "out"
    assert run_protocol(exam, out, tmp_path, 3.0, workers=ThisMachine(), quiet=True) == ["2.50 points, fewer than 3"]
    found = json.loads((out / "report.json").read_text())
    assert {driver: each["points"] for driver, each in found["drivers"].items()} == {"ads": 2.5, "autopilot": 1.75}
    assert "the ADS: 2.50 of 2.5 points" in capsys.readouterr().out
    page = " ".join((out / "report.html").read_text().split())
    assert "The parked vehicles of CPNCO hid nobody" in page
    assert "passes the protocol and fails with people" in page
    assert (out / "view.html").is_file()
    written = yaml.safe_load((out / "scenarios" / "CPNCO-50_30kmh.yaml").read_text())
    assert len(written["parked"]) == 2
