"""Euro NCAP's car-to-pedestrian tests as far as a kinematic world can run them: definitions and points.

The protocol is "Crash Avoidance, Frontal Collisions", version 1.1 of October 2025 (for ratings from January 2026), by
its sections below. Two of its figures are pictures whose numbers its text does not repeat. The colour bands (figure
5-1), and which cells are of the standard range, are as Euro NCAP's own rating software has them
(github.com/Euro-NCAP/euroncap_rating_2026). NOT VERIFIED in the protocol itself, since they stand in its drawings alone
(figures 3-17 to 3-24), are the distances in `Test`: how far the target begins from the vehicle's path, over how much it
accelerates, where it crosses in turning tests, and the gaps beside the parked vehicles. They are those of Vector's
OSC-NCAP-scenarios (github.com/vectorgrp/OSC-NCAP-scenarios), for turning those of the protocol before, AEB/LSS VRU
4.5.1.

The vehicle drives along x, a left-hand-drive car on the right side of the road: nearside is its right.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vpsci_ros.data.episode import Episode
from vpsci_ros.exam.recorded_people import FAR, Motion
from vpsci_ros.safety import PEDESTRIAN_RADIUS, VEHICLE_LENGTH, VEHICLE_WIDTH, contact_step
from vpsci_ros.world import Recorded, Scenario, World, WorldConfig
from vpsci_ros.world.tick import Actions

Floats = NDArray[np.float64]
VERSION = "Euro NCAP, Crash Avoidance, Frontal Collisions, version 1.1, October 2025"
KMH = 1.0 / 3.6  # [m/s]
FIRST_NUMBER = 150  # of the scenarios, by `cells`
EPISODE_TIME = 18.0  # [s]
_FRONT = 0.5 * VEHICLE_LENGTH  # [m] before the centre
_APPROACH = 5.0  # [s] at least from the beginning to the impact; tests start 4 s before it (section 1.5.1, T0)
_STANDS = 1.0  # [s] at least that the target stands before it sets off
_STEP = 0.1  # [m] between the points of a path


Turn = tuple[float, float, float]
"""The path of a turning test (section 1.2.4), clothoid, arc, clothoid: R2 [m], alpha and beta [degrees]."""
FARSIDE = {10: (9.0, 20.62, 48.75), 15: (11.75, 20.93, 48.14), 20: (14.75, 21.79, 46.42)}
NEARSIDE = {10: (8.0, 22.85, 44.30)}
WIDEST = 1500.0  # [m] R1
LANE_OFFSET = 1.75  # [m] of the vehicle from the middle of its road (section 3.2.2.1)


@dataclass(frozen=True)
class Test:
    """One daytime test of the protocol, with its standard range of speeds and impact locations.

    :ivar section: of the protocol, which gives speeds and points.
    :ivar points: of the standard range.
    :ivar speeds: of the vehicle [km/h].
    :ivar locations: of the impact, from the right edge of the vehicle (0%) to the left one (100%) (section 1.2.5) [%];
        that these are the standard range is NOT VERIFIED in the protocol, see above.
    :ivar target: speed of the pedestrian [km/h].
    :ivar side: it comes from: -1 the right (nearside), 1 the left; in turning tests 1 walks as the vehicle drove
        before its turn, and -1 the other way.
    :ivar distance: from where it stands to the impact at 50% [m]; NOT VERIFIED.
    :ivar acceleration: distance over which it takes up its speed [m]; NOT VERIFIED.
    :ivar turn: speed of the vehicle [km/h] -> its path; None: straight on.
    :ivar left: the turn is to the left (farside).
    :ivar obstructed: two parked vehicles hide the target.
    :ivar cluster: name under which the points of turns to both sides count together; empty: its own.
    """

    section: str
    points: float
    speeds: tuple[int, ...]
    locations: tuple[int, ...]
    target: float
    side: int
    distance: float
    acceleration: float
    turn: Mapping[int, Turn] | None = None
    left: bool = False
    obstructed: bool = False
    cluster: str = ""


_TENS = (10, 20, 30, 40, 50, 60)
TESTS = {
    "CPNA": Test("3.2.3.1", 0.5, _TENS, (25, 50, 75), 5.0, -1, 4.0, 1.0),
    "CPFA": Test("3.2.3.1", 0.5, _TENS, (50,), 8.0, 1, 6.0, 1.5),
    "CPNCO": Test("3.2.3.1", 1.0, _TENS, (50,), 5.0, -1, 4.0, 1.0, obstructed=True),
    "CPTAfs": Test("3.2.2.1", 1.0, (10, 15, 20), (50,), 5.0, 1, 9.5, 2.0, FARSIDE, left=True,
                   cluster="CPTAfs & CPTAns"),
    "CPTAns": Test("3.2.2.1", 1.0, (10,), (50,), 5.0, 1, 6.0, 2.0, NEARSIDE, cluster="CPTAfs & CPTAns"),
    "CPTAfo": Test("3.2.2.1", 1.0, (10, 15, 20), (50,), 5.0, -1, 6.0, 2.0, FARSIDE, left=True,
                   cluster="CPTAfo & CPTAno"),
    "CPTAno": Test("3.2.2.1", 1.0, (10,), (50,), 5.0, -1, 9.5, 2.0, NEARSIDE, cluster="CPTAfo & CPTAno"),
}  # fmt: skip
TITLES = {
    "CPNA": "adult crossing from the nearside",
    "CPFA": "adult running from the farside",
    "CPNCO": "child from behind parked vehicles",
    "CPTAfs & CPTAns": "turning, adult walks in the vehicle's direction before the turn",
    "CPTAfo & CPTAno": "turning, adult walks the other way",
}
SLOW = Test("5.1", 0.0, (20,), (75,), 3.0, -1, 4.0, 1.0)  # no points without it: the vehicle has to slow down
REQUIRED = (("CPNA", 10, 75), ("slow", 20, 75))
"""What section 5.1 wants before any point counts: that speed is reduced in these cells, the second one with `SLOW`."""
CROSSING_LINE = 9.5  # [m] of the target's path from the middle of the vehicle's road, in turning tests; NOT VERIFIED
GAP = 1.0  # [m] beside, before and between the parked vehicles; NOT VERIFIED
SMALLER, LARGER = (4.25, 1.80), (4.50, 1.82)  # [m] length and width of the parked vehicles, within appendix B

COLOURS = {"green": 1.0, "yellow": 0.75, "orange": 0.5, "brown": 0.25, "red": 0.0}
"""Colour of a cell -> its score (section 5.3.1)."""
BANDS = {
    10: (("green", 0.0),),
    20: (("green", 0.0),),
    30: (("green", 0.0), ("brown", 10.0)),
    40: (("green", 0.0), ("orange", 10.0), ("brown", 20.0)),
    50: (("green", 0.0), ("yellow", 10.0), ("orange", 20.0), ("brown", 30.0)),
}
"""Test speed [km/h] -> largest impact speed [km/h] of each colour, red beyond; 60 is as 50.

NOT VERIFIED in the protocol, where they are a picture (figure 5-1): as Euro NCAP's rating software has them.

The same for 60 km/h stands in the example of section 4.2.4. In turning tests green is avoidance alone (section 5.2).
"""

LEFT_OUT = (
    "by night (CPNAnight, CPFAnight, CPNCOnight: 2.0 points): the world has no light",
    "a pedestrian walking along the road (CPLA by day and night: section 3.2.1.1), and its warnings",
    "bicyclists, motorcyclists, cars, and every test at low speed, of lane departure and of warnings",
    "the extended range (impacts at 10 and 90%, turns at 25 km/h) and the robustness layers (sections 5.2.1, 5.3.3)",
    "a robot that steers: the system steers all the time, and who drives around the target has avoided it",
    "sensors, unless ads_test.perception is on; tyres, suspension, brakes that take time, belts, seats",
    "in turns, the middle of the front axle on the path of section 1.2.4: here the middle of the vehicle is on it",
    "bodies: a rectangle of 4.69 m by 1.85 m touches a disc of 0.3 m radius, not a profile the box around a dummy",
    "the manufacturer's predictions and their verification (section 4): every cell is driven, once",
)
"""What a kinematic world leaves out of the car-to-pedestrian tests."""


class Cell(NamedTuple):
    """One test at one speed and impact location.

    :ivar number: of its scenario.
    """

    number: int
    test: str
    speed: int  # [km/h]
    location: int  # [%]

    @property
    def spec(self) -> Test:
        """The protocol's definition of the test."""
        return SLOW if self.test == "slow" else TESTS[self.test]

    @property
    def name(self) -> str:
        """The cell's name, such as CPNA-25_30kmh."""
        return f"{self.test}-{self.location}_{self.speed}kmh"


def cells() -> list[Cell]:
    """Return all tested cells; the last one is the required cell with the slow pedestrian."""
    named = [*TESTS.items(), ("slow", SLOW)]
    wanted = [(name, speed, place) for name, test in named for speed in test.speeds for place in test.locations]
    return [Cell(FIRST_NUMBER + n, *each) for n, each in enumerate(wanted)]


def document(cell: Cell) -> dict[str, Any]:
    """Return the scenario of a cell, as the content of a scenario's YAML file."""
    test, speed, time = cell.spec, cell.speed * KMH, _time_to_impact(cell)
    run_up = 10.0 + speed * time
    if test.turn is None:
        points, across = np.array([[0.0, 0.0], [run_up + 60.0, 0.0]]), np.array([0.0, -test.side])
        middle = np.array([run_up + _FRONT + PEDESTRIAN_RADIUS, 0.0])
        at = run_up
    else:
        bend = _bend(test.turn[cell.speed], 1.0 if test.left else -1.0)
        line = LANE_OFFSET + (CROSSING_LINE if test.left else -CROSSING_LINE)
        at, middle = _where_front_meets(bend, line)
        across = np.array([float(test.side), 0.0])
        points = np.vstack([[-(run_up - at), 0.0], bend])
        at = run_up
    start = middle - test.distance * across
    end = middle + 8.0 * across
    lane = {"centreline": np.round(points, 6).tolist(), "spawn": [at - speed * time] * 2, "goal": at + 12.0,
            "throttle": [1.0, 1.0], "full_throttle_speed": speed, "initial_speed": [1.0, 1.0]}  # fmt: skip
    walk = {"route": np.round([start, end], 6).tolist(), "goal": test.distance + 7.0, "arrival": [5.0, 5.0],
            "speed": [test.target * KMH] * 2, "offset": [0.0, 0.0], "standing_room": 0.0}  # fmt: skip
    return {
        "number": cell.number,
        "name": cell.name,
        "location": "Euro NCAP",
        "description": f"{VERSION}, section {test.section}: {cell.name}",
        "vehicle": lane,
        "pedestrian": walk,
    } | ({"parked": _parked(float(middle[0]))} if test.obstructed else {})


def _time_to_impact(cell: Cell) -> float:
    """Return when the impact is, from the beginning of the episode [s]."""
    test = cell.spec
    reach = test.distance + VEHICLE_WIDTH  # the farthest impact on the vehicle's width
    return max(_APPROACH, _STANDS + _time_of_walk(test, reach))


def _time_of_walk(test: Test, way: float) -> float:
    """Return how long the target takes for `way` [m] from standing [s]: first uniformly accelerated, then steady."""
    return 2.0 * test.acceleration / (test.target * KMH) + (way - test.acceleration) / (test.target * KMH)


def _walked(test: Test, time: Floats) -> tuple[Floats, Floats]:
    """Return how far the target is from where it stood [m] and its speed [m/s], `time` [s] after it set off."""
    top = test.target * KMH
    takes_up = 2.0 * test.acceleration / top
    gained = np.clip(time / takes_up, 0.0, 1.0)
    return test.acceleration * gained**2 + top * np.maximum(0.0, time - takes_up), top * gained


def _bend(turn: Turn, side: float) -> Floats:
    """Return points of a turn from the origin, along x, and of 45 m straight on after it, float64[N, 2] [m]."""
    radius, alpha, beta = turn
    tightest, widest = 1.0 / radius, 1.0 / WIDEST
    clothoid = 2.0 * math.radians(alpha) / (tightest + widest)
    arc = math.radians(beta) * radius
    step = 0.01
    s = np.arange(0.0, 2.0 * clothoid + arc + 45.0, step)
    knots = [0.0, clothoid, clothoid + arc, 2.0 * clothoid + arc, 2.0 * clothoid + arc + step]
    curvature = np.interp(s, knots, [widest, tightest, tightest, widest, 0.0])
    curvature[s > knots[-1]] = 0.0
    heading = side * np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * step)])
    middle = 0.5 * (heading[1:] + heading[:-1])
    points = np.vstack([[0.0, 0.0], np.cumsum(np.stack([np.cos(middle), np.sin(middle)], axis=1) * step, axis=0)])
    return points[:: round(_STEP / step)]


def _where_front_meets(bend: Floats, line: float) -> tuple[float, Floats]:
    """Return where along a bend [m] the vehicle's centre is when the disc before its front is on y = `line`; and it."""
    heading = np.arctan2(*np.gradient(bend, axis=0).T[::-1])
    ahead = bend + (_FRONT + PEDESTRIAN_RADIUS) * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    at = int(np.argmax(np.abs(ahead[:, 1]) >= abs(line)))
    return at * _STEP, np.array([ahead[at, 0], line])


def _parked(path: float) -> list[dict[str, float]]:
    """Return the two vehicles that hide the child, who crosses at x = `path` [m]."""
    aside = -(0.5 * VEHICLE_WIDTH + GAP + 0.5 * LARGER[1])
    front = path - PEDESTRIAN_RADIUS - GAP
    behind = front - SMALLER[0] - GAP
    return [{"x": first - 0.5 * length, "y": aside, "length": length, "width": width}
            for first, (length, width) in ((front, SMALLER), (behind, LARGER))]  # fmt: skip


def motion(scenarios: Sequence[Scenario], config: WorldConfig) -> Motion:
    """Return the target's motion in each cell's episode: a vehicle at constant speed hits it at the cell's location.

    The place of the impact follows from the vehicle as the world drives it along its path.

    :param scenarios: of cells, their numbers among those of `cells`.
    """
    known = {cell.number: cell for cell in cells()}
    times: Floats = np.arange(config.episode_ticks + 1, dtype=np.float64) * config.tick
    found: Motion = {}
    for scenario, driven in zip(scenarios, _driven(scenarios, config), strict=True):
        cell = known[scenario.number]
        test, route = cell.spec, scenario.pedestrian.path
        start, end = route.points[0], route.points[-1]
        across = (end - start) / np.linalg.norm(end - start)
        when, place = _impact(driven, cell, start, np.array([-across[1], across[0]]))
        sets_off = when * config.tick - _time_of_walk(test, float((place - start) @ across))
        since: Floats = times - sets_off
        way, speed = _walked(test, since)
        found[scenario.number, 0] = np.hstack([start + way[:, None] * across, speed[:, None] * across])
    return found


def _driven(scenarios: Sequence[Scenario], config: WorldConfig) -> Floats:
    """Return x, y [m] and heading [rad] of the vehicle, float64[B, T, 3], without a pedestrian, at constant speed."""
    keys = [(scenario.number, 0) for scenario in scenarios]
    far = np.array([[FAR, FAR, 0.0, 0.0]])
    nobody = Recorded({key: (np.zeros((1, 5)), far) for key in keys})
    world = World(config, scenarios, keys, len(keys), 0, nobody)
    rows, commands = [], Actions(vehicle=np.zeros((len(keys), 2)))
    while not world.done:
        rows.append(np.stack([world.state[name] for name in ("vehicle_x", "vehicle_y", "vehicle_heading")], axis=-1))
        world.advance(world.now.unassessed(), commands)
    return np.array(rows[:-1]).transpose(1, 0, 2)


def _impact(driven: Floats, cell: Cell, start: Floats, normal: Floats) -> tuple[float, Floats]:
    """Return the tick (fractional) at which the vehicle is where it hits the target, and where the target is then.

    There the middle of the target's disc is before the front by its radius, at the cell's share of the width.
    """
    x, y, heading = driven.T
    ahead, aside = _FRONT + PEDESTRIAN_RADIUS, (cell.location / 100.0 - 0.5) * VEHICLE_WIDTH
    cos, sin = np.cos(heading), np.sin(heading)
    places = np.stack([x + ahead * cos - aside * sin, y + ahead * sin + aside * cos], axis=1)
    beside = (places - start) @ normal
    last = int(np.flatnonzero(np.sign(beside[1:]) != np.sign(beside[:-1]))[0])
    part = beside[last] / (beside[last] - beside[last + 1])
    return last + part, places[last] + part * (places[last + 1] - places[last])


def impact_speed(episode: Episode) -> float:
    """Return the vehicle's speed at the contact [km/h], interpolated between frames; 0 without a contact.

    A test ends when the vehicle stands (section 4.3.2), so what comes after that does not count.
    """
    seen = episode.filled()
    touched = contact_step(seen.x, seen.y, seen.heading, seen.ped_x[0], seen.ped_y[0])
    if touched == math.inf or (seen.speed[: math.ceil(touched) + 1] <= 0.0).any():
        return 0.0
    return float(np.interp(touched, np.arange(len(seen)), seen.speed)) / KMH


def colour_of(cell: Cell, speed: float) -> str:
    """Return the colour of a cell for an impact speed [km/h] (section 5.2)."""
    bands = BANDS[10] if cell.spec.turn is not None else BANDS[min(50, cell.speed)]
    return next((colour for colour, most in bands if speed <= most), "red")


def rated(speeds: Mapping[int, float]) -> dict[str, Any]:
    """Return a driving system's points in each test, as JSON values; None for all points while cells are not driven.

    :param speeds: number of a cell's scenario -> impact speed [km/h]; a cell that is not in it was not driven.
    """
    rows: dict[str, list[dict[str, Any]]] = {}
    unmet, missing = [], []
    for cell in cells():
        speed = speeds.get(cell.number)
        if speed is None:
            missing.append(cell.name)
        elif (cell.test, cell.speed, cell.location) in REQUIRED and speed > cell.speed - 0.1:
            unmet.append(cell.name)
        if cell.test != "slow":
            row = {"number": cell.number, "test": cell.test, "speed": cell.speed, "location": cell.location,
                   "impact": speed, "colour": "" if speed is None else colour_of(cell, speed)}  # fmt: skip
            rows.setdefault(cell.spec.cluster or cell.test, []).append(row)
    tests: dict[str, dict[str, Any]] = {}
    for name, listed in rows.items():
        spec = TESTS[listed[0]["test"]]
        score = sum(COLOURS.get(row["colour"], 0.0) for row in listed) * spec.points / len(listed)
        tests[name] = {"title": TITLES[name], "section": spec.section, "points": None if missing else round(score, 2),
                       "of": spec.points, "drawn": drawn(name), "cells": listed}  # fmt: skip
    of = sum(test["of"] for test in tests.values())
    points = None if missing else 0.0 if unmet else round(sum(test["points"] for test in tests.values()), 2)
    return {"points": points, "of": of, "passed": not missing and not unmet and points == of, "unmet": unmet,
            "missing": missing, "tests": tests}  # fmt: skip


def drawn(name: str) -> list[str]:
    """Return, in words, the values of a test, or of a cluster, that stand in the protocol's drawings alone.

    All but the colours and locations are those of Vector's OSC-NCAP-scenarios, see above.
    """
    specs = {test: spec for test, spec in TESTS.items() if name in (test, spec.cluster)}
    out = [] if any(spec.turn for spec in specs.values()) else ["colours of the speeds at the impact"]
    out.append("impact locations of the standard range")
    for test, spec in specs.items():
        where = f" ({test})" if len(specs) > 1 else ""
        out.append(
            f"target stands {spec.distance:g} m from the impact and speeds up over {spec.acceleration:g} m{where}"
        )
    if any(spec.turn for spec in specs.values()):
        out.append(f"target's path {CROSSING_LINE:g} m from the middle of the vehicle's road")
    if any(spec.obstructed for spec in specs.values()):
        out.append(f"gaps of {GAP:g} m at the parked vehicles")
    return out
