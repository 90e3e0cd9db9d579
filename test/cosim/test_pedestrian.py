"""The pedestrian in anybody's engine: time steps, late vehicles, hand-over and release, and what is refused."""

import math
import pickle
import re
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from vpsci_ros import Pedestrian, Vehicle, Walker
from vpsci_ros.cosim import Walk
from vpsci_ros.errors import InvalidInput
from vpsci_ros.policy.policy_file import Policy, load_policy

ROUTE = [(0.0, -8.0), (0.0, 8.0)]  # north, across a road along x
AT_THE_KERB = Walker(0.0, -5.0, 0.0, 1.2)


@pytest.fixture(scope="module")
def weights() -> Policy:
    return load_policy("people")


def car(time: float, speed: float = 5.0, meets: float = 4.0, **more: Any) -> Vehicle:
    """Return a car at constant speed whose front is at the walker's line `meets` seconds after the beginning."""
    return Vehicle(-2.345 - speed * (meets - time), 0.0, 0.0, speed, **{"curvature": 0.0, "acceleration": 0.0} | more)


def crossing(pedestrian: Pedestrian, seconds: float = 10.0, period: float = 0.05, gone: float = math.inf) -> list[Walk]:
    """Walk; the car is there until it has `gone` [s]."""
    own, walked = AT_THE_KERB, []
    for k in range(round(seconds / period)):
        time = k * period
        walked.append(pedestrian.step(own, {"car": car(time)} if time < gone else {}, period=period))
        own = Walker(*walked[-1][:4])
    return walked


@pytest.mark.timeout(600)  # it compiles kernels where it is the first to need them
def test_it_is_there_without_ros_and_torch() -> None:
    code = (
        "import sys\n"
        "for name in ('torch', 'rclpy', 'vpsci_msgs', 'gymnasium', 'matplotlib', 'polars'): sys.modules[name] = None\n"
        "from vpsci_ros import Driver, Pedestrian, Vehicle, Walker\n"
        "walk = Pedestrian(goal=(0.0, 8.0)).step(Walker(0.0, -5.0), {'car': Vehicle(-20.0, 0.0, 0.0, 5.0)})\n"
        "drive = Driver(lane=[(-30, 0), (30, 0)]).step(Vehicle(-20.0, 0.0, 0.0, 3.0), {'he': Walker(0.0, -5.0)})\n"
        "print(walk.controlled, drive.controlled)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=500)
    assert done.stdout == "False False\n", done.stderr


def test_it_hands_over_below_5_s_and_gives_back_3_s_after_the_last_critical_tick(weights: Policy) -> None:
    walked = crossing(Pedestrian(weights, seed=3, route=ROUTE, speed=1.2))
    controlled = [walk.controlled for walk in walked]
    critical = [walk.curvttc < 5.0 for walk in walked]
    taken, given = controlled.index(True), len(controlled) - controlled[::-1].index(True)
    first, last = critical.index(True), len(critical) - 1 - critical[::-1].index(True)
    assert taken == first + first % 2, "at the first policy frame, every second tick, that is critical"
    assert given - 1 - last in (60, 61), "3 s are 60 ticks; given back at a policy frame"
    assert all(controlled[taken:given])
    assert not any(controlled[given:])
    assert all(walk.faces == "car" for walk in walked)


@pytest.mark.parametrize(("speed", "beyond"), [(3.0, False), (9.0, True)])
def test_it_tells_whether_the_hand_over_lay_beyond_the_recorded_range(
    weights: Policy, speed: float, beyond: bool
) -> None:
    # Right turns were recorded at 0.5 to 5.3 m/s and 3 to 20 m; at 3 m/s the car is 15 m away, 4 s before they meet.
    pedestrian, own = Pedestrian(weights, seed=3, route=ROUTE, speed=1.2), AT_THE_KERB
    assert pedestrian.person.beyond is None
    for k in range(4):
        walk = pedestrian.step(own, {"car": car(0.05 * k, speed=speed)}, period=0.05)
        own = Walker(*walk[:4])
    assert walk.controlled
    assert pedestrian.person.beyond is beyond


def test_without_a_vehicle_it_walks_its_route_at_its_pace_and_on_beyond_its_end(weights: Policy) -> None:
    pedestrian = Pedestrian(weights, seed=3, route=ROUTE, speed=1.2)
    walked = crossing(pedestrian, seconds=20.0, gone=0.0)
    assert not any(walk.controlled or walk.faces is not None or walk.curvttc < math.inf for walk in walked)
    assert [walk.arrived for walk in walked].index(True) * 0.05 == pytest.approx(13.0 / 1.2, rel=0.15)
    assert max(abs(walk.x) for walk in walked) < 0.7, "its sway"
    assert walked[-1].y > 15.0
    assert math.hypot(walked[-1].vx, walked[-1].vy) == pytest.approx(1.2, rel=0.3)


@pytest.mark.parametrize("period", [0.1, 1 / 15])
def test_at_another_time_step_it_does_nearly_the_same(weights: Policy, period: float) -> None:
    """The vehicle keeps its speed, as ticks within a step expect. Of seeds 1 to 12 only 4 chooses other reactions."""
    usual = crossing(Pedestrian(weights, seed=3, route=ROUTE, speed=1.2), seconds=6.0)
    other = crossing(Pedestrian(weights, seed=3, route=ROUTE, speed=1.2), seconds=6.0, period=period)
    then = np.array([[walk.x, walk.y] for walk in other])
    times = np.arange(1, len(then) + 1) * period
    expected = np.array([AT_THE_KERB[:2], *((walk.x, walk.y) for walk in usual)])
    own = np.stack([np.interp(times, np.arange(len(expected)) * 0.05, column) for column in expected.T], axis=1)
    assert np.abs(then - own).max() < 0.03
    assert any(walk.controlled for walk in other)


def test_of_several_vehicles_it_faces_the_one_with_the_least_curvttc(weights: Policy) -> None:
    alone, several = (Pedestrian(weights, seed=4, route=ROUTE, speed=1.2) for _ in range(2))
    one, other = AT_THE_KERB, AT_THE_KERB
    for k in range(100):
        time = k * 0.05
        near, parked_by = car(time), Vehicle(5.0, -3.0, 0.0, 0.0, 0.0, 0.0)
        first = alone.step(one, {"car": near})
        second = several.step(other, {"stands": parked_by, "car": near, "behind": car(time, meets=9.0)})
        if math.isinf(first.curvttc) and k > 40:
            break  # the car has passed, and the one behind it counts
        assert first == second
        one, other = Walker(*first[:4]), Walker(*second[:4])
    assert k > 40
    later, sooner = car(0.0, meets=4.5), car(0.0, meets=4.0)
    for order in ({"later": later, "sooner": sooner}, {"sooner": sooner, "later": later}):
        assert Pedestrian(weights, route=ROUTE).step(AT_THE_KERB, order).faces == "sooner"


def test_what_is_hidden_by_a_parked_vehicle_is_not_reacted_to_until_it_is_seen(weights: Policy) -> None:
    hides = [[-4.0, -2.6, 0.0, 6.0, 2.0]]  # between the walker and the car that comes along y = 0
    free, hidden = (Pedestrian(weights, seed=3, route=ROUTE, speed=1.2) for _ in range(2))
    vehicle = {"car": car(1.0)}
    seen = [free.step(AT_THE_KERB, vehicle) for _ in range(2)]
    unseen = [hidden.step(AT_THE_KERB, vehicle, parked=hides) for _ in range(2)]
    assert seen[0].curvttc == unseen[0].curvttc < 5.0
    assert seen[0].controlled
    assert not any(walk.controlled for walk in unseen)
    assert hidden.step(AT_THE_KERB, vehicle, parked=[]).controlled


def test_curvature_and_acceleration_are_found_from_the_step_before(weights: Policy) -> None:
    """On a circle of 20 m at 4 m/s the heading turns by 0.2 rad/s; one of them is told, the other sees for itself."""
    told, seeing = (Pedestrian(weights, seed=3, route=ROUTE) for _ in range(2))
    for k in range(3):
        heading, speed = 0.2 * 0.05 * k, 4.0 + 0.5 * 0.05 * k
        place = 20.0 * math.sin(heading) - 18.0, 20.0 - 20.0 * math.cos(heading), heading, speed
        first = told.step(AT_THE_KERB, {0: Vehicle(*place, 0.05, 0.5)}).curvttc
        second = seeing.step(AT_THE_KERB, {0: Vehicle(*place)}).curvttc
    assert second == pytest.approx(first, rel=0.02)
    straight = Pedestrian(weights, seed=3, route=ROUTE).step(AT_THE_KERB, {0: Vehicle(*place)}).curvttc
    assert straight != pytest.approx(first, rel=0.02), "without a step before: straight on"


def test_a_copy_in_mid_episode_goes_on_to_the_bit(weights: Policy) -> None:
    pedestrian = Pedestrian(weights, seed=1, episode=4, route=ROUTE)
    crossing(pedestrian, 3.0)
    assert crossing(pickle.loads(pickle.dumps(pedestrian)), 3.0) == crossing(pedestrian, 3.0)


GOOD: dict[str, Any] = {"own": AT_THE_KERB, "vehicles": {"car": Vehicle(-20.0, 0.0, 0.0, 5.0)}}


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"own": (0.0, 1.0)}, "own: expected a vpsci_ros.Walker, got tuple"),
        ({"own": Walker(math.nan, 0.0)}, "own: x = nan: expected a finite number"),
        ({"own": Walker(0.0, 1e154)}, "own: y = 1e+154: expected a finite number, 2e+07 at most"),
        (
            {"vehicles": [Vehicle(0.0, 0.0, 0.0, 1.0)]},
            "vehicles: expected a mapping from who it is to a vpsci_ros.Vehicle",
        ),
        ({"vehicles": {"car": Vehicle(0.0, 0.0, math.inf, 1.0)}}, "vehicle 'car': heading = inf: expected a finite"),
        (
            {"vehicles": {"car": Vehicle(0.0, 0.0, 0.0, 1.0, length=0.0)}},
            "vehicle 'car': length = 0 m: expected a size",
        ),
        ({"parked": [[0.0, 0.0, 0.0]]}, "boxes: expected [K, 5] of x, y, heading, length, width, got shape (1, 3)"),
        ({"period": 0.0}, "period = 0.0: expected the time to the next step [s], from 0.001 to 2"),
    ],
)
def test_a_bad_step_is_refused_and_changes_nothing(weights: Policy, bad: dict[str, Any], message: str) -> None:
    pedestrian, control = (Pedestrian(weights, seed=3, route=ROUTE) for _ in range(2))
    with pytest.raises(InvalidInput, match=re.escape(message)):
        pedestrian.step(**{**GOOD, **bad})
    assert pedestrian.step(**GOOD) == control.step(**GOOD)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({}, "Pedestrian: expected one of scenario, route and goal, got none of them"),
        ({"route": [(0.0, 0.0)]}, "route: expected at least two finite points [x, y] in metres"),
        ({"route": [(0.0, 0.0), (0.0, 0.5)]}, "route: expected 1 m or more, got 0.50 m"),
        ({"goal": (0.0, math.nan)}, "goal: expected (x, y) [m], both finite"),
        ({"route": ROUTE, "speed": 9.0}, "speed = 9.0: expected a walking speed from 0.4 to 5 m/s"),
        ({"scenario": 1, "number": 1}, "number = 1: episode 0 of seed 0 has pedestrians 0 to 0"),
        ({"route": ROUTE, "weights": "best"}, "weights 'best': expected a .safetensors file or a shipped name"),
        ({"goal": (9.0, 0.0), "weights": "best"}, "weights 'best': expected a .safetensors file or a shipped name"),
        ({"route": ROUTE, "episode": 1.5}, "Pedestrian, episode: expected int or integer, got 1.5"),
        ({"route": ROUTE, "config": {}}, "Pedestrian, config: expected WorldConfig or NoneType, got {}"),
    ],
)
def test_a_pedestrian_that_cannot_be_is_refused(bad: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInput, match=re.escape(message)):
        Pedestrian(**bad)
