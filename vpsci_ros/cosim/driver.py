"""The default driver as one object for your own simulation engine."""

import math
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vpsci_ros.cosim import inputs
from vpsci_ros.cosim.agent import Agent, seen
from vpsci_ros.cosim.inputs import Vehicle, Walker, checked, checked_all
from vpsci_ros.cosim.routes import scenario_along
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


class Driver(Agent[Vehicle]):
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

    _what, _kind, _ways, _paced = "vehicle", Vehicle, ("scenario", "lane"), ("cruise_throttle", "driver_onset")
    _speeds = LEAST_CAR, GREATEST_CAR, f"{LEAST_CAR:g} to {GREATEST_CAR:g} m/s, as recorded drivers turn right"

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
        super().__init__(locals())
        if lane is not None:  # it keeps its pace, wherever it may meet somebody
            self._make(scenario_along(lane, "lane"), meeting_s=math.inf, driver_onset=0)
        self._keys: list[Hashable | None] = [None] * MOST  # who is in which row

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
        boxes, duration = inputs.checked_parked(parked), inputs.checked_period(period)
        boxes, record = self._parked if boxes is None else boxes, self._record
        unsaid = [name for name in ("curvature", "acceleration") if getattr(own, name) is None]
        began = own._replace(**{name: float(record[f"vehicle_{name}"]) for name in unsaid})
        self._seat(own, walkers)
        ttc, _ = self._look(began, walkers)
        row = int(ttc.argmin())

        def tick(now: Vehicle, gone: float) -> None:
            later = dict(zip(walkers, inputs.walked_on(walkers.values(), gone), strict=True))
            self._locate(now.x, now.y)
            last = max((row for row, key in enumerate(self._keys) if key is not None), default=0)
            self._put(now, [None if key is None else later[key] for key in self._keys[: last + 1]])
            self._advance(*self._look(now, later), boxes)

        def partly(now: Vehicle, time: float) -> Vehicle:
            controls = (float(record[name]) for name in ("steer", "throttle", "brake"))
            x, y, heading, speed, _ = drive(*now[:4], *controls, time)
            return now._replace(x=x, y=y, heading=heading, speed=speed)

        now = self._moved(began, duration, tick, partly)
        names = ("vehicle_curvature", "steer", "throttle", "brake")
        faces, controlled = self._keys[row] if walkers else None, bool(self._state["controlled"].any())
        motion = (*now[:4], (now.speed - own.speed) / period, *(float(record[name]) for name in names))
        return Drive._make((*motion, float(ttc[row]), faces, controlled, bool(record["vehicle_goal"])))

    def _seat(self, own: Vehicle, walkers: dict[Hashable, Walker]) -> None:
        """Give each of the nearest pedestrians a row, which it keeps while it is among them."""
        nearest = sorted(walkers, key=lambda key: math.hypot(walkers[key].x - own.x, walkers[key].y - own.y))[:MOST]
        for row, key in enumerate(self._keys):
            if key is not None and key not in nearest:
                self._keys[row] = None
                self._state["hold"][row] = 0
        for key in walkers:
            if key in nearest and key not in self._keys:
                self._keys[self._keys.index(None)] = key

    def _look(self, own: Vehicle, walkers: dict[Hashable, Walker]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return CurvTTC [s] and distance [m] of each row, float64[MOST]; infinity and NaN where nobody is."""
        ttc, distance = np.full(MOST, np.inf), np.full(MOST, np.nan)
        rows = [row for row, key in enumerate(self._keys) if key is not None]
        if rows:
            ttc[rows], distance[rows] = seen([own], [walkers[self._keys[row]] for row in rows])
        return ttc, distance
