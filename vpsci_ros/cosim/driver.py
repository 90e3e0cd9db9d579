"""The default driver as one object for your own simulation engine."""

import math
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.cosim.agent import Body, Clock, Person
from vpsci_ros.cosim.inputs import (
    Vehicle,
    Walker,
    checked,
    checked_all,
    checked_parked,
    checked_period,
    require_kinds,
    walked_on,
)
from vpsci_ros.cosim.routes import named_scenario, scenario_of_lane
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.policy_config import PolicyConfig
from vpsci_ros.policy.policy_file import Policy
from vpsci_ros.world import Scenario, WorldConfig
from vpsci_ros.world.calibration import GREATEST_CAR, LEAST_CAR
from vpsci_ros.world.crowd import MOST
from vpsci_ros.world.kinematics import drive


class Drive(NamedTuple):
    """The vehicle's motion to the next step, and the pedestrian and CurvTTC that are the reason for it.

    :ivar x, y, heading: [m, rad] at the next step, for engines that place bodies.
    :ivar speed: [m/s] at the next step.
    :ivar acceleration: [m/s2] mean over the step.
    :ivar curvature: [1/m] of its path in the last tick, positive to the left.
    :ivar steer, throttle, brake: of the last tick, -1 (right) to 1 (left), 0 to 1, 0 to 1, of a Tesla Model 3.
    :ivar curvttc: [s] to the pedestrian that it faces, at the beginning of the step; infinity without a contact.
    :ivar faces: key of that pedestrian; None without one.
    :ivar controlled: whether the policy drives, rather than the autopilot.
    :ivar arrived: whether it has reached the goal of its lane; it drives on.
    """

    x: float
    y: float
    heading: float
    speed: float
    acceleration: float
    curvature: float
    steer: float
    throttle: float
    brake: float
    curvttc: float
    faces: Hashable | None
    controlled: bool
    arrived: bool


class Driver:
    """One default driver of a Tesla Model 3 in its lane; give exactly one of `scenario` and `lane`.

    The autopilot drives until CurvTTC of a visible pedestrian falls below 5 s. Then the policy sets the speed,
    until 3 s after the last critical tick. The driver keeps its lane and does not see other vehicles.

    :param weights: a file, a name shipped with the package, or a `Bank` or `Weights`.
    :param seed: of every random draw; with `episode` and the scenario's number it determines the person.
    :param scenario: by number, name, file, or as a `Scenario`.
    :param lane: float[N, 2] [m], centreline of its lane; bends with a radius below 5.6 m are refused.
    :param speed: [m/s] with nothing near; None: drawn from recorded right turns, 0.4 to 5.6.
    :param config: periods and hand-over; its drivers are ignored.
    :param policy: random draws; None: by `seed`.
    :raises InvalidInput: not exactly one of scenario and lane, or a refused value.
    """

    def __init__(
        self,
        weights: str | Path | Policy = "people",
        *,
        seed: int = 0,
        episode: int = 0,
        scenario: int | str | Path | Scenario | None = None,
        lane: ArrayLike | None = None,
        speed: float | None = None,
        config: WorldConfig | None = None,
        policy: PolicyConfig | None = None,
    ) -> None:
        require_kinds("Driver", locals())
        if speed is not None and not LEAST_CAR <= speed <= GREATEST_CAR:
            raise InvalidInput(
                f"speed = {speed!r}: expected {LEAST_CAR:g} to {GREATEST_CAR:g} m/s, as recorded drivers turn right"
            )
        config = config or WorldConfig()
        if scenario is not None and lane is None:
            found = named_scenario(scenario)
        elif lane is not None and scenario is None:
            found = scenario_of_lane(lane)
        else:
            raise InvalidInput("Driver: expected one of scenario and lane")
        self._body = Body("vehicle", weights, found, seed, episode, 0, config, policy)
        self._full = found.vehicle.full_throttle_speed
        if scenario is None:
            self._body.begin(meeting_s=math.inf, driver_onset=0)  # it keeps its pace, wherever it may meet somebody
        if speed is not None:
            self._body.begin(cruise_throttle=speed / self._full, driver_onset=0)
        self._clock = Clock(config.tick)
        self._keys: list[Hashable | None] = [None] * MOST  # who is in which row

    @property
    def start(self) -> Vehicle:
        """The vehicle's state: before the first step at the spawn, later at the end of the last tick begun."""
        names = ("x", "y", "heading", "speed", "curvature", "acceleration")
        return Vehicle(*(float(self._body.record[f"vehicle_{name}"]) for name in names))

    @property
    def person(self) -> Person:
        """The drawn person; before the hand-over, `recorded` is -1 and `beyond` is None."""
        return self._body.person(float(self._body.record["cruise_throttle"]) * self._full)

    def step(
        self,
        own: Vehicle,
        pedestrians: Mapping[Hashable, Walker],
        parked: ArrayLike | None = None,
        period: float = 0.05,
    ) -> Drive:
        """Return the vehicle's motion to the next step.

        :param own: its present state; the sizes are the Tesla Model 3's.
        :param pedestrians: states by key; a key names the same pedestrian in every step. The nearest `MOST` count; the
            driver reacts to the visible one with the least CurvTTC.
        :param parked: float[K, 5]: x, y [m], heading [rad], length, width [m] of vehicles that hide pedestrians; None:
            the scenario's.
        :param period: [s] to the next step, 0.001 to 2; it may change.
        :raises InvalidInput: a refused value, or a negative speed; the driver is unchanged then.
        """
        own = checked("own", own, Vehicle)
        if own.speed < 0.0:
            raise InvalidInput(f"own: speed = {own.speed:g} m/s: expected 0 or more, for this driver does not reverse")
        walkers = checked_all("pedestrian", pedestrians, Walker)
        boxes, duration = checked_parked(parked), checked_period(period)
        body, record = self._body, self._body.record
        boxes = body.parked if boxes is None else boxes
        now = own._replace(
            curvature=float(record["vehicle_curvature"]) if own.curvature is None else own.curvature,
            acceleration=float(record["vehicle_acceleration"]) if own.acceleration is None else own.acceleration,
        )
        self._seat(own, walkers)
        ttc, _ = self._look(now, walkers)
        row = int(ttc.argmin())
        for begins, part, gone in self._clock.parts(duration):
            if begins:
                self._tick(now, dict(zip(walkers, walked_on(walkers.values(), gone), strict=True)), boxes)
            if part == self._clock.tick:
                now = self.start
            else:
                controls = (float(record[name]) for name in ("steer", "throttle", "brake"))
                x, y, heading, speed, _ = drive(now.x, now.y, now.heading, now.speed, *controls, part * 1e-9)
                now = now._replace(x=x, y=y, heading=heading, speed=speed)
        curvature, steer, throttle, brake = (
            float(record[name]) for name in ("vehicle_curvature", "steer", "throttle", "brake")
        )
        return Drive(
            x=now.x,
            y=now.y,
            heading=now.heading,
            speed=now.speed,
            acceleration=(now.speed - own.speed) / period,
            curvature=curvature,
            steer=steer,
            throttle=throttle,
            brake=brake,
            curvttc=float(ttc[row]),
            faces=self._keys[row] if walkers else None,
            controlled=bool(body.state["controlled"].any()),
            arrived=bool(record["vehicle_goal"]),
        )

    def _seat(self, own: Vehicle, walkers: dict[Hashable, Walker]) -> None:
        """Give each of the nearest pedestrians a row, which it keeps while it is among them."""
        nearest = sorted(walkers, key=lambda key: math.hypot(walkers[key].x - own.x, walkers[key].y - own.y))[:MOST]
        for row, key in enumerate(self._keys):
            if key is not None and key not in nearest:
                self._keys[row] = None
                self._body.state["hold"][row] = 0
        for key in walkers:
            if key in nearest and key not in self._keys:
                self._keys[self._keys.index(None)] = key

    def _look(self, own: Vehicle, walkers: dict[Hashable, Walker]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return CurvTTC [s] and distance [m] of each row, float64[MOST]; infinity and NaN where nobody is."""
        ttc, distance = np.full(MOST, np.inf), np.full(MOST, np.nan)
        rows = [row for row, key in enumerate(self._keys) if key is not None]
        if rows:
            ttc[rows], distance[rows] = self._body.seen([own], [walkers[self._keys[row]] for row in rows])
        return ttc, distance

    def _tick(self, own: Vehicle, walkers: dict[Hashable, Walker], parked: NDArray[np.float64]) -> None:
        body = self._body
        ttc, distance = self._look(own, walkers)
        body.locate("vehicle", own.x, own.y)
        body.put_vehicle(own)
        last = max((row for row, key in enumerate(self._keys) if key is not None), default=0)
        body.put_walkers([None if key is None else walkers[key] for key in self._keys[: last + 1]])
        body.tick(ttc, distance, parked)
