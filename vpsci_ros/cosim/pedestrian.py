"""The default pedestrian as one object for your own simulation engine."""

import math
from collections.abc import Hashable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.cosim import inputs
from vpsci_ros.cosim.agent import Agent, seen
from vpsci_ros.cosim.inputs import Vehicle, Walker, checked, checked_all
from vpsci_ros.cosim.routes import scenario_along
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

_SETS_OFF = {"start_delay": 0.0, "walk_slope": 0.0, "walker_onset": 0}  # at once, and does not cross obliquely
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


class Pedestrian(Agent[Walker]):
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

    _what, _kind, _ways, _paced = "pedestrian", Walker, ("scenario", "route", "goal"), ("walking_speed", "walker_onset")
    _speeds = LEAST_WALK, 5.0, f"a walking speed from {LEAST_WALK:g} to 5 m/s"

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
        super().__init__(locals())
        self._goal: Any = goal
        self._since = 0.0
        self._cars: dict[Hashable, Vehicle] = {}  # of the last step
        self._faces: Hashable | None = None
        self._stood: dict[Hashable, float] = {}  # [s] for which a vehicle stands
        self._goes_round = False
        if route is not None:
            self._make(scenario_along(route, "route"), **_SETS_OFF)
        elif goal is not None and inputs.as_points(goal).shape != (2,):
            raise InvalidInput(f"goal: expected (x, y) [m], both finite, got {shown(goal)}")

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
        boxes, duration = inputs.checked_parked(parked), inputs.checked_period(period)
        if not len(self._state):
            self._make(scenario_along([(own.x, own.y), self._goal], "route"), **_SETS_OFF)
        boxes = self._parked if boxes is None else boxes
        cars = {key: inputs.completed(car, self._cars.get(key), self._since) for key, car in cars.items()}
        self._cars, self._since = cars, period
        stood = {key: self._stood.get(key, 0.0) + period for key, car in cars.items() if car.speed < STANDS}
        self._stood = stood
        nearest = sorted(range(len(others)), key=lambda k: math.hypot(others[k].x - own.x, others[k].y - own.y))
        crowd = [others[k] for k in sorted(nearest[: MOST - 1])]
        faces, ttc, _ = self._look(own, cars, boxes)

        def tick(now: Walker, gone: float) -> None:
            later = {key: inputs.driven_on(car, gone) for key, car in cars.items()}
            self._tick(now, later, inputs.walked_on(crowd, gone), boxes)

        def partly(now: Walker, time: float) -> Walker:
            pushed = float(self._record["pedestrian_ax"]), float(self._record["pedestrian_ay"])
            return Walker(*walk(*now, *pushed, 1.0, math.inf, time))

        now = self._moved(own, duration, tick, partly)
        change = (now.vx - own.vx) / period, (now.vy - own.vy) / period
        controlled = bool(self._record["controlled"]) and not self._goes_round
        return Walk(*now, *change, ttc, faces, controlled, bool(self._record["pedestrian_goal"]))

    def _look(
        self, own: Walker, cars: dict[Hashable, Vehicle], parked: NDArray[np.float64]
    ) -> tuple[Hashable | None, float, float]:
        """Return the key of the vehicle that the pedestrian faces, CurvTTC [s] and centre distance [m]."""
        if not cars:
            return None, math.inf, math.nan
        keys, vehicles = list(cars), list(cars.values())
        ttc, distance = seen(vehicles, [own])
        heading = np.array([car.heading for car in vehicles])
        eye_x = [car.x for car in vehicles] + EYE_FORWARD * np.cos(heading)
        eye_y = [car.y for car in vehicles] + EYE_FORWARD * np.sin(heading)
        faced = np.array([key == self._faces for key in keys])
        hidden = visible_share(eye_x, eye_y, own.x, own.y, parked) < LEAST_VISIBLE
        hidden &= ~(faced & bool(self._record["controlled"]))  # whom it reacts to already it does not forget
        best = int(np.lexsort((distance, ~faced, ttc, hidden))[0])
        return keys[best], float(ttc[best]), float(distance[best])

    def _tick(
        self, own: Walker, cars: dict[Hashable, Vehicle], others: list[Walker], parked: NDArray[np.float64]
    ) -> None:
        others_ahead, push = self._way_round(own, cars)
        found = self._look(own, others_ahead, parked)
        if push is not None and found[1] < CRITICAL_TTC:  # a moving vehicle is more pressing
            push, found = None, self._look(own, cars, parked)
        self._faces, ttc, distance = found
        self._locate(own.x, own.y)
        if self._faces is None or (self._goes_round and push is None):
            self._state["hold"] = 0  # nothing is left to keep control for
        self._goes_round = push is not None
        before = [*others[: self._number], *([None] * (self._number - len(others)))]
        faced = None if self._faces is None else cars[self._faces]
        self._put(faced, [*before, own, *others[self._number :]])
        ttcs, distances = np.full(MOST, np.inf), np.full(MOST, np.nan)
        ttcs[self._number], distances[self._number] = ttc if push is None else 0.0, distance
        self._advance(ttcs, distances, parked, push)

    def _way_round(
        self, own: Walker, cars: dict[Hashable, Vehicle]
    ) -> tuple[dict[Hashable, Vehicle], tuple[float, float] | None]:
        """Return the vehicles besides those that the pedestrian walks round, and its acceleration [m/s2] round them.

        It walks round vehicles that have stood for `WAITS` across its way; None: there are none.
        """
        stand = [car for key, car in cars.items() if self._stood.get(key, 0.0) >= WAITS]
        boxes = [np.array([car.x, car.y, car.heading, car.length, car.width]) for car in stand]
        if not boxes:
            return cars, None
        path, s, here = self._world.scenarios[0].pedestrian.path, float(self._record["pedestrian_s"]), (own.x, own.y)
        if self._record["table"]:  # the other way
            path = replace(path, points=path.points[::-1])
        points = [path.at(place) for place in np.arange(s + FURTHER, max(s + FURTHER, path.length) + 20.0)]
        target = next((p for p in points if not any(meets(p, p, box, ROOM) for box in boxes)), points[-1])
        if not any(meets(here, p, box, ROOM) for p in (path.at(s + WALK_LOOK_AHEAD), target) for box in boxes):
            return cars, None
        x, y = next_point(here, target, boxes)
        pace, way = float(self._record["walking_speed"]), math.hypot(x - own.x, y - own.y) or 1.0
        ax, ay = walk_acceleration(pace * (x - own.x) / way - own.vx, pace * (y - own.y) / way - own.vy, FIRM, SOON)
        return {key: car for key, car in cars.items() if self._stood.get(key, 0.0) < WAITS}, (ax, ay)
