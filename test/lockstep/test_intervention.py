"""What is changed between a driving system's command and the car: one episode at a time."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.lockstep.intervention import NOT_FORCED, Intervention, intervened, read_changes, write_changes
from vpsci_ros.world import World, WorldConfig, load_scenarios
from vpsci_ros.world.kinematics import MAX_DECELERATION
from vpsci_ros.world.tick import NO_ACTIONS, Actions

SCENARIOS = load_scenarios([1, 2])
ONE, TWO = (1, 0), (2, 0)


def speeds(changes: dict[tuple[int, int], Intervention], commands: Any, ticks: int = 20) -> np.ndarray:
    """Return the speeds of the cars of 1:0 and 2:0, float64[ticks, 2], under one command to both at each tick."""
    world = World(WorldConfig(spawn="paper", vehicle_driver="external"), SCENARIOS, [ONE, TWO], 2, 1)
    found = []
    for tick in range(ticks):
        found.append(world.state["vehicle_speed"].copy())
        command = np.tile(commands(tick), (2, 1))
        given = Actions(vehicle=command) if command.shape[1] == 2 else Actions(vehicle_control=command)
        world.advance(world.now.unassessed(), intervened(changes, world.state, given))
    return np.array(found)


def test_one_episode_is_changed_and_no_other() -> None:
    as_it_is = speeds({}, lambda _: (0.5, 0.0))
    changed = speeds({ONE: Intervention(frame=5, speed=-0.7)}, lambda _: (0.5, 0.0))
    assert changed[:, 1] == pytest.approx(as_it_is[:, 1], abs=0.0)
    assert changed[:6, 0] == pytest.approx(as_it_is[:6, 0], abs=0.0)
    assert changed[6:, 0] == pytest.approx(as_it_is[6:, 0] - 0.7, abs=1e-12)


def test_braking_is_firmer_from_1_m_s2_on_up_to_what_the_car_can() -> None:
    gentle, firm, fullest = (
        np.diff(speeds({ONE: Intervention(firmer=2.0)}, lambda _, a=a: (a, 0.0), 3)[:, 0])[0] / 0.05
        for a in (-0.99, -1.0, -8.0)
    )
    assert (gentle, firm, fullest) == pytest.approx((-0.99, -3.0, -MAX_DECELERATION))


def test_forced_braking_is_the_least_and_the_system_has_the_car_before_and_after_it() -> None:
    forced = Intervention(frame=4, forced=(-2.0, NOT_FORCED, -2.0))
    found = np.diff(speeds({ONE: forced}, lambda k: (-3.0 if k == 6 else 0.4, 0.0), 9)[:, 0]) / 0.05
    assert found == pytest.approx([0.4] * 4 + [-2.0, 0.4, -3.0, 0.4])


def test_throttle_and_brake_are_changed_as_accelerations_are_and_steering_is_left_alone() -> None:
    change = {ONE: Intervention(firmer=1.0, frame=2, forced=(-4.44,))}
    found = np.diff(speeds(change, lambda k: (0.0, 0.0, 0.25 if k == 0 else 0.0), 4)[:, 0]) / 0.05
    assert found == pytest.approx([-(0.25 * 8.88 + 1.0), 0.0, -4.44])
    command = Actions(vehicle_control=np.array([[0.3, 0.5, 0.0]] * 2))
    world = World(WorldConfig(spawn="paper", vehicle_driver="external"), SCENARIOS, [ONE, TWO], 2, 1)
    changes = {ONE: Intervention(forced=(-8.88,))}
    assert intervened(changes, world.state, command).vehicle_control.tolist() == [[0.3, 0.0, 1.0], [0.3, 0.5, 0.0]]


def test_a_speed_is_held_until_the_system_brakes_firmly_and_then_let_go_for_good() -> None:
    first = speeds({}, lambda _: (0.0, 0.0), 1)[0, 0]
    held = {ONE: Intervention(held=first)}
    found = speeds(held, lambda k: (-3.0 if k == 6 else -2.9 if k < 6 else -1.0, 0.0), 10)[:, 0]
    assert found[:7] == pytest.approx([first] * 7, abs=0.0)
    assert np.diff(found[6:]) / 0.05 == pytest.approx([-3.0, -1.0, -1.0])


def test_without_a_command_there_is_none_to_change() -> None:
    world = World(WorldConfig(spawn="paper", vehicle_driver="external"), SCENARIOS, [ONE, TWO], 2, 1)
    assert intervened({ONE: Intervention(firmer=1.0)}, world.state, NO_ACTIONS) is NO_ACTIONS


def test_changes_come_back_from_their_file_as_they_were_and_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "changes.json"
    starts = {ONE: (0.1 + 0.2, -1.5), TWO: (0.0, 0.0)}
    changes = {ONE: Intervention(7, -0.5, 0.25, (-1.0, -2.0), 4.0), TWO: Intervention()}
    write_changes(path, starts, changes)
    assert read_changes(path) == (starts, changes)
    for text in ("{}", "[]", '{"head_starts": [[1, 0, 2.0]], "interventions": []}',
                 '{"head_starts": [], "interventions": [[1, 0, 4, 0.0, 0.0, "hard", 0.0]]}'):  # fmt: skip
        path.write_text(text)
        with pytest.raises(InvalidInput, match="expected head starts and interventions as an exam writes them"):
            read_changes(path)
