"""The default pedestrian as one object for your own simulation engine."""

import math
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.cosim.agent import Body, Clock, Person
from vpsci_ros.cosim.inputs import (
    GREATEST,
    Tracks,
    Vehicle,
    Walker,
    checked,
    checked_all,
    checked_parked,
    checked_period,
    driven_on,
    require_kinds,
    walked_on,
)
from vpsci_ros.cosim.routes import named_scenario, scenario_of_walk
from vpsci_ros.cosim.way_round import ROOM, meets, next_point
from vpsci_ros.documents import shown
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.policy_config import PolicyConfig
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.safety import CRITICAL_TTC, visible_share
from vpsci_ros.world import Scenario, WorldConfig
from vpsci_ros.world.calibration import LEAST_WALK
from vpsci_ros.world.crowd import MOST
from vpsci_ros.world.drivers.walker import WALK_LOOK_AHEAD, walk_acceleration
from vpsci_ros.world.kinematics import walk
from vpsci_ros.world.parked import EYE_FORWARD, LEAST_VISIBLE

STANDS, WAITS = 0.1, 3.0  # [m/s] and [s]: a slower vehicle stands; after so long a pedestrian walks round it
FURTHER = 6.0  # [m] along the route, where the way round leads to at least
FIRM, SOON = 2.0, 0.3  # [m/s2] at most, and [s] in which it takes its direction round a vehicle


class Walk(NamedTuple):
    """The pedestrian's motion to the next step, and the vehicle and CurvTTC that are the reason for it.

    :ivar x, y: [m] at the next step, for engines that place bodies.
    :ivar vx, vy: [m/s] at the next step.
    :ivar ax, ay: [m/s2] mean acceleration over the step.
    :ivar curvttc: [s] to the vehicle that it faces, at the beginning of the step; infinity without a contact.
    :ivar faces: key of that vehicle; None without one.
    :ivar controlled: whether the policy moves it, rather than the rule-based walker.
    :ivar arrived: whether it has reached the end of its route.
    """

    x: float
    y: float
    vx: float
    vy: float
    ax: float
    ay: float
    curvttc: float
    faces: Hashable | None
    controlled: bool
    arrived: bool


class Pedestrian:
    """One default pedestrian; give exactly one of `scenario`, `route` and `goal`.

    It walks its route until CurvTTC of a visible vehicle falls below 5 s. From the next policy frame the
    policy moves it, until 3 s after the last critical tick. Policy frames come every 0.1 s from the first step.
    It walks round a vehicle that has stood for 3 s across its way.

    :param weights: a file, a name shipped with the package, or a `Bank` or `Weights`.
    :param seed: of every random draw; with `episode` and the scenario's number it determines the person.
    :param scenario: by number, name, file, or as a `Scenario`; pace, line and delay are drawn for this episode.
    :param route: float[N, 2] [m], walked from the first step to its end.
    :param goal: (x, y) [m], reached straight from the place of the first step.
    :param speed: [m/s] with nothing near; None: drawn from recorded people.
    :param number: of the pedestrian within an episode of several, see `WorldConfig.pedestrians`.
    :param config: periods, kinds of pedestrian, hand-over; its drivers are ignored.
    :param policy: random draws; None: by `seed`.
    :raises InvalidInput: not exactly one of scenario, route and goal, or a refused value.
    """

    def __init__(
        self,
        weights: str | Path | Policy = "people",
        *,
        seed: int = 0,
        episode: int = 0,
        scenario: int | str | Path | Scenario | None = None,
        route: ArrayLike | None = None,
        goal: tuple[float, float] | None = None,
        speed: float | None = None,
        number: int = 0,
        config: WorldConfig | None = None,
        policy: PolicyConfig | None = None,
    ) -> None:
        require_kinds("Pedestrian", locals())
        ways = {"scenario": scenario, "route": route, "goal": goal}
        if len(given := [name for name, way in ways.items() if way is not None]) != 1:
            raise InvalidInput(f"Pedestrian: expected one of scenario, route and goal, got {given or 'none of them'}")
        if speed is not None and not LEAST_WALK <= speed <= 5.0:
            raise InvalidInput(f"speed = {speed!r}: expected a walking speed from {LEAST_WALK:g} to 5 m/s")
        self._speed, self._goal = speed, goal
        self._config = config or WorldConfig()
        self._made = weights, seed, episode, number, self._config, policy
        self._tracks, self._clock = Tracks(), Clock(self._config.tick)
        self._number, self._since = number, 0.0
        self._faces: Hashable | None = None
        self._stood: dict[Hashable, float] = {}  # [s] for which a vehicle stands
        self._goes_round = False
        self._body: Body | None = None
        if scenario is not None:
            self._body = self._new_body(named_scenario(scenario))
        elif route is not None:
            self._body = self._new_body(scenario_of_walk(route), straight=True)
        elif not _is_point(goal):
            raise InvalidInput(f"goal: expected (x, y) [m], both finite, got {shown(goal)}")

    @property
    def start(self) -> Walker:
        """The pedestrian's state: before the first step at the spawn, later at the end of the last tick begun.

        :raises InvalidInput: before the first step of a pedestrian with a `goal`.
        """
        record = self._made_body().record
        return Walker(*(float(record[f"pedestrian_{name}"]) for name in Walker._fields))

    @property
    def person(self) -> Person:
        """The drawn person; before the hand-over, `recorded` is -1 and `beyond` is None.

        :raises InvalidInput: before the first step of a pedestrian with a `goal`.
        """
        body = self._made_body()
        return body.person(float(body.record["walking_speed"]))

    def step(
        self,
        own: Walker,
        vehicles: Mapping[Hashable, Vehicle],
        pedestrians: Mapping[Hashable, Walker] | None = None,
        parked: ArrayLike | None = None,
        period: float = 0.05,
    ) -> Walk:
        """Return the pedestrian's motion to the next step.

        :param own: its present state.
        :param vehicles: states by key; a key names the same vehicle in every step. The pedestrian faces the visible
            one with the least CurvTTC; of equal ones the one faced before, then the nearest.
        :param pedestrians: the other pedestrians, from whom it keeps apart; the nearest `MOST` - 1 count.
        :param parked: float[K, 5]: x, y [m], heading [rad], length, width [m] of vehicles that hide others; None: the
            scenario's.
        :param period: [s] to the next step, 0.001 to 2; it may change.
        :raises InvalidInput: a refused value; the pedestrian is unchanged then.
        """
        own = checked("own", own, Walker)
        cars = checked_all("vehicle", vehicles, Vehicle)
        others = list(checked_all("pedestrian", {} if pedestrians is None else pedestrians, Walker).values())
        boxes, duration = checked_parked(parked), checked_period(period)
        body = self._body = self._body or self._new_body(self._to_goal(own), straight=True)
        boxes = body.parked if boxes is None else boxes
        cars, self._since = self._tracks.completed(cars, self._since), period
        stood = {key: self._stood.get(key, 0.0) + period for key, car in cars.items() if car.speed < STANDS}
        self._stood = stood
        nearest = sorted(range(len(others)), key=lambda k: math.hypot(others[k].x - own.x, others[k].y - own.y))
        crowd = [others[k] for k in sorted(nearest[: MOST - 1])]
        faces, ttc, _ = self._look(body, own, cars, boxes)
        now = own
        for begins, part, gone in self._clock.parts(duration):
            if begins:
                later = {key: driven_on(car, gone) for key, car in cars.items()}
                self._tick(body, now, later, walked_on(crowd, gone), boxes)
            if part == self._clock.tick:
                now = self.start
            else:
                pushed = float(body.record["pedestrian_ax"]), float(body.record["pedestrian_ay"])
                now = Walker(*walk(*now, *pushed, 1.0, math.inf, part * 1e-9))
        change = (now.vx - own.vx) / period, (now.vy - own.vy) / period
        controlled, arrived = (
            bool(body.record["controlled"]) and not self._goes_round,
            bool(body.record["pedestrian_goal"]),
        )
        return Walk(*now, *change, ttc, faces, controlled, arrived)

    def _made_body(self) -> Body:
        if self._body is None:
            raise InvalidInput("this pedestrian walks to a goal from where it is: call step first")
        return self._body

    def _to_goal(self, own: Walker) -> Scenario:
        assert self._goal is not None
        return scenario_of_walk([(own.x, own.y), self._goal])

    def _new_body(self, scenario: Scenario, straight: bool = False) -> Body:
        """Return a body; with `straight` the walker sets off at once and does not cross obliquely."""
        weights, seed, episode, number, config, policy = self._made
        body = Body("pedestrian", weights, scenario, seed, episode, number, config, policy)
        if straight:
            body.begin(start_delay=0.0, walk_slope=0.0, walker_onset=0)
        if self._speed is not None:
            body.begin(walking_speed=self._speed, walker_onset=0)
        return body

    def _look(
        self, body: Body, own: Walker, cars: dict[Hashable, Vehicle], parked: NDArray[np.float64]
    ) -> tuple[Hashable | None, float, float]:
        """Return the key of the vehicle that the pedestrian faces, CurvTTC [s] and centre distance [m]."""
        if not cars:
            return None, math.inf, math.nan
        keys, vehicles = list(cars), list(cars.values())
        ttc, distance = body.seen(vehicles, [own])
        heading = np.array([car.heading for car in vehicles])
        eye_x = [car.x for car in vehicles] + EYE_FORWARD * np.cos(heading)
        eye_y = [car.y for car in vehicles] + EYE_FORWARD * np.sin(heading)
        faced = np.array([key == self._faces for key in keys])
        hidden = visible_share(eye_x, eye_y, own.x, own.y, parked) < LEAST_VISIBLE
        hidden &= ~(faced & bool(body.record["controlled"]))  # whom it reacts to already it does not forget
        best = int(np.lexsort((distance, ~faced, ttc, hidden))[0])
        return keys[best], float(ttc[best]), float(distance[best])

    def _tick(
        self,
        body: Body,
        own: Walker,
        cars: dict[Hashable, Vehicle],
        others: list[Walker],
        parked: NDArray[np.float64],
    ) -> None:
        others_ahead, push = self._way_round(body, own, cars)
        found = self._look(body, own, others_ahead, parked)
        if push is not None and found[1] < CRITICAL_TTC:  # a moving vehicle is more pressing
            push, found = None, self._look(body, own, cars, parked)
        self._faces, ttc, distance = found
        body.locate("pedestrian", own.x, own.y)
        if self._goes_round and push is None:
            body.begin(hold=0)
        self._goes_round = push is not None
        if self._faces is None:
            body.begin(hold=0)  # nothing is left to keep control for
        else:
            body.put_vehicle(cars[self._faces])
        before = [*others[: self._number], *([None] * (self._number - len(others)))]
        body.put_walkers([*before, own, *others[self._number :]])
        ttcs, distances = np.full(MOST, np.inf), np.full(MOST, np.nan)
        ttcs[self._number], distances[self._number] = ttc if push is None else 0.0, distance
        body.tick(ttcs, distances, parked, push)

    def _way_round(
        self, body: Body, own: Walker, cars: dict[Hashable, Vehicle]
    ) -> tuple[dict[Hashable, Vehicle], tuple[float, float] | None]:
        """Return the vehicles besides those that the pedestrian walks round, and its acceleration [m/s2] round them.

        It walks round vehicles that have stood for `WAITS` across its way; None: there are none.
        """
        boxes = [
            np.array([c.x, c.y, c.heading, c.length, c.width])
            for k, c in cars.items()
            if self._stood.get(k, 0.0) >= WAITS
        ]
        if not boxes:
            return cars, None
        path, s, here = body.walk, float(body.record["pedestrian_s"]), (own.x, own.y)
        points = [path.at(place) for place in np.arange(s + FURTHER, max(s + FURTHER, path.length) + 20.0)]
        target = next((p for p in points if not any(meets(p, p, box, ROOM) for box in boxes)), points[-1])
        if not any(meets(here, p, box, ROOM) for p in (path.at(s + WALK_LOOK_AHEAD), target) for box in boxes):
            return cars, None
        x, y = next_point(here, target, boxes)
        pace, way = float(body.record["walking_speed"]), math.hypot(x - own.x, y - own.y) or 1.0
        ax, ay = walk_acceleration(pace * (x - own.x) / way - own.vx, pace * (y - own.y) / way - own.vy, FIRM, SOON)
        return {key: car for key, car in cars.items() if self._stood.get(key, 0.0) < WAITS}, (ax, ay)


def _is_point(value: Any) -> bool:
    try:
        point = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        return False
    return point.shape == (2,) and bool((np.abs(point) <= GREATEST).all())
