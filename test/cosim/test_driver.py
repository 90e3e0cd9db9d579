"""The driver in anybody's engine: its lane, whom it faces, time steps, and what is refused."""

import re
from typing import Any

import pytest

from vpsci_ros import Driver, Vehicle, Walker
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.policy_file import Policy, load_policy

LANE = [(-40.0, 0.0), (40.0, 0.0)]
BEGINS = Vehicle(-20.0, 0.5, 0.0, 3.0)


@pytest.fixture(scope="module")
def weights() -> Policy:
    return load_policy("people")


def driven(driver: Driver, seconds: float, period: float = 0.05, people: Any = None) -> list[Any]:
    own, steps = BEGINS, []
    for k in range(round(seconds / period)):
        steps.append(driver.step(own, people(k * period) if people else {}, period=period))
        own = Vehicle(*steps[-1][:4])
    return steps


def test_alone_it_keeps_to_its_lane_at_its_pace(weights: Policy) -> None:
    steps = driven(Driver(weights, seed=2, lane=LANE, speed=4.0), 12.0)
    assert abs(steps[-1].y) < 0.3
    assert sum(step.speed for step in steps[60:]) / len(steps[60:]) == pytest.approx(4.0, abs=0.5)
    assert not any(step.controlled or step.faces is not None for step in steps)


def test_the_policy_drives_while_somebody_crosses_and_gives_back(weights: Policy) -> None:
    steps = driven(Driver(weights, seed=2, lane=LANE), 14.0, people=lambda t: {"he": Walker(0.0, -6.0 + t, 0.0, 1.0)})
    controlled = [step.controlled for step in steps]
    assert any(controlled)
    assert not controlled[-1]
    assert steps[controlled.index(True)].faces == "he"
    assert steps[controlled.index(True)].curvttc < 5.0


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({}, "Driver: expected one of scenario and lane"),
        ({"lane": LANE, "scenario": 1}, "Driver: expected one of scenario and lane"),
        ({"lane": LANE, "speed": 14.0}, "speed = 14.0: expected 0.4 to 5.6 m/s"),
        ({"lane": [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0)]}, "lane, vehicle: centreline has a bend of radius"),
    ],
)
def test_a_driver_that_cannot_be_is_refused(bad: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInput, match=re.escape(message)):
        Driver(**bad)
