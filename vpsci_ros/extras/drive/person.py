"""A person as the driving system of an exam: the page shows each tick, the pressed keys drive."""

import time

from vpsci_ros.exam.drivers import Begin, Observation
from vpsci_ros.extras.drive.drive_page import Page, Pressed
from vpsci_ros.world.kinematics import brake_for, steer_for, throttle_for

SIDEWAYS = 4.0  # [m/s2] to which a pressed key turns the wheel: less, the faster the vehicle is
FORWARD, BACKWARD = 3.0, -8.0  # [m/s2] of a pressed pedal
TURNING = 2.0  # [1/s] of the wheel's way from its middle to one end
TREADING = 4.0  # [1/s] of a pedal's way


class Person:
    """A person as a driver, see `vpsci_ros.exam.drivers`.

    :param period: of a tick [s].
    :param factor: simulated over wall time.
    """

    def __init__(self, page: Page, period: float, factor: float) -> None:
        self._page, self._period, self._tick = page, period, period / factor
        self._held, self._due = Pressed(), 0.0

    def reset(self, begin: Begin) -> None:
        """Begin an episode without pressed keys."""
        self._held = Pressed()

    def act(self, observation: Observation) -> tuple[float, float, float]:
        """Show the tick, wait for its duration, and return steer, throttle and brake.

        :raises Left: nobody is there any more.
        """
        self._page.show(observation.time, observation.vehicle, observation.pedestrians)
        if observation.time == 0.0:
            self._page.wait_until_ready()
            self._due = time.monotonic()
        self._due = max(self._due + self._tick, time.monotonic())  # who is late does not hurry
        self._page.wait(self._due)
        self._page.require_person()
        self._held = held(self._held, self._page.pressed, observation.vehicle.speed, self._period)
        return self._held


def held(before: Pressed, pressed: Pressed, speed: float, period: float) -> Pressed:
    """Return steer, throttle and brake after keys were pressed for `period` [s] at `speed` [m/s].

    Keys know on and off alone, so wheel and pedals follow them at the pace of hands and feet.
    """
    wanted = (
        pressed.steer * steer_for(SIDEWAYS, speed),
        pressed.throttle * throttle_for(FORWARD),
        pressed.brake * brake_for(BACKWARD),
    )
    most = TURNING * period, TREADING * period, TREADING * period
    return Pressed(*(min(max(to, at - step), at + step) for at, to, step in zip(before, wanted, most, strict=True)))
