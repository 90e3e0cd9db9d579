"""Parked vehicles hide, are run into, and change nothing where there are none."""

import copy

import pytest
from world.helpers import alarm, nothing

from vpsci_ros.errors import InvalidInput
from vpsci_ros.world import PARKED_COLLISION, Scenario, World, WorldConfig, load_scenario
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.parked import in_sight, parked_from
from vpsci_ros.world.scenario import scenario_from
from vpsci_ros.world.state import RUNNING

VAN = {"x": 20.0, "y": -3.5, "length": 6.0, "width": 2.0}
ROW = {"x": 8.0, "y": -3.5, "length": 30.0, "width": 2.0}  # hides the pavement to x = 25 m from where the car begins
STRAIGHT = {
    "number": 50,
    "name": "straight",
    "location": "here",
    "vehicle": {"centreline": [[0, 0], [100, 0]], "spawn": [0, 0], "goal": 60, "initial_speed": [1.0, 1.0]},
    "pedestrian": {"route": [[25, -9], [25, 9]], "goal": 14, "arrival": [6, 6], "standing_room": 0.0,
                   "speed": [1.5, 1.5], "offset": [0, 0]},
}  # fmt: skip
PAPER = WorldConfig(spawn="paper")


def straight(*parked: dict) -> Scenario:
    return scenario_from(copy.deepcopy(STRAIGHT) | {"parked": list(parked)}, "here")


def world(*parked: dict, config: WorldConfig = PAPER, batch: int = 1) -> World:
    return World(config, [straight(*parked)], [(50, e) for e in range(batch)], batch, 1)


def test_no_policy_acts_before_it_has_seen_the_other_and_once_handed_over_the_pair_stays_so() -> None:
    with_row, without = world(ROW), world()
    parked = parked_from(with_row.scenarios)
    handed = {}
    for name, each in (("row", with_row), ("free", without)):
        while not each.done and name not in handed:
            if each.now.policy_frame[0]:
                assert name == "free" or in_sight(each.state, parked)[0]
            events = each.advance(alarm(each), nothing(each))
            if 2 in events["kind"]:
                handed[name] = int(events["frame"][events["kind"] == 2][0])
    assert handed["free"] == 0
    assert handed["row"] > 20
    # The pedestrian stands, the car drives back to where it was hidden: they have seen each other, and stay in control.
    with_row.state["vehicle_x"] = 2.0
    with_row.state["pedestrian_x"], with_row.state["pedestrian_y"] = 25.0, -5.0
    assert not in_sight(with_row.state, parked)[0]
    assert with_row.state["controlled"][0] == 1
    for _ in range(4):
        with_row.advance(alarm(with_row), nothing(with_row))
        assert with_row.state["controlled"][0] == 1


def test_a_car_that_touches_a_parked_one_has_had_its_episode() -> None:
    standing = {"x": 30.0, "y": 0.9}
    run = world(standing, config=WorldConfig(spawn="paper", vehicle_driver="autopilot", pedestrian_driver="autopilot"))
    run.state["pedestrian_y"] = -50.0
    steps = list(Loop(run))
    last = steps[-1].tick.state[0]
    assert last["outcome"] == PARKED_COLLISION
    # Bumper to bumper: 4.69 m from centre to centre, and not a tick later than it takes to be there.
    assert 30.0 - 4.69 <= last["vehicle_x"] < 30.0 - 4.69 + last["vehicle_speed"] * 0.05
    assert [e["outcome"] for step in steps for e in step.events if e["kind"] == 4] == [PARKED_COLLISION]


def test_parked_vehicles_that_hide_nothing_change_no_bit() -> None:
    far = {"x": 500.0, "y": 500.0}
    config = WorldConfig()
    one, other = (
        [step.tick.state.tobytes() for step in Loop(world(*parked, config=config, batch=16))] for parked in ((), (far,))
    )
    assert one == other


def test_bits_do_not_depend_on_the_batch_nor_on_other_scenarios() -> None:
    own = load_scenario(104)
    episodes = [(104, e) for e in range(12)]

    def ends(scenarios: list[Scenario], pairs: list[tuple[int, int]], batch: int) -> dict[int, bytes]:
        found = {}
        for step in Loop(World(WorldConfig(), scenarios, pairs, batch, 1)):
            for record in step.tick.state[step.tick.state["status"] == RUNNING]:
                if record["scenario"] == 104:
                    found[int(record["episode"])] = record.tobytes()
        return found

    alone = ends([own], episodes, 12)
    # `table` is the row of a scenario in its world, so the same place is kept for it.
    mixed = ends([own, load_scenario(1), straight(VAN)], [*episodes, (1, 0), (50, 0)], 5)
    assert alone == mixed


@pytest.mark.parametrize(
    ("parked", "message"),
    [
        ([{"x": 25.0, "y": -4.0}], r"parked\[0\]: stands in the way of the pedestrian, whose route passes \(25.0, -4"),
        ([VAN, {"x": 1.0}], r"parked\[1\]: missing y"),
        ([{"x": 1.0, "y": 30.0, "lenght": 2.0}], r"unknown parameter 'lenght'; did you mean length"),
        ([VAN] * 33, "at most 32 vehicles"),
    ],
)
def test_a_bad_vehicle_is_refused_with_file_key_and_reason(parked: object, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        scenario_from(copy.deepcopy(STRAIGHT) | {"parked": parked}, "here")
