"""What the driver of a car gets at a tick, and which answers are commands."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.drivers import Begin, Cockpit, DrivenLoop, Observation, command_of_answer
from vpsci_ros.safety import HORIZON
from vpsci_ros.world import World, WorldConfig, load_scenario
from vpsci_ros.world.loop import Loop


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (None, "act returned None"),
        (float("nan"), "act returned nan"),
        ((51.0, 0.0), r"act returned \(51.0, 0.0\)"),
        ((0.0, 1.5, 0.0), r"act returned \(0.0, 1.5, 0.0\)"),
        ("brake", "act returned 'brake'"),
        ("5", "act returned '5'"),
        (True, "act returned True"),
        (np.True_, "act returned "),
        ([0.5, True], r"act returned \[0.5, True\]"),
        ([[1.0], [1.0, 2.0]], "act returned "),
        (10**400, "act returned "),
        ([1.0] * 4, "expected an acceleration along the car"),
        ([[1.0], [2.0]], "expected an acceleration along the car"),
        (np.zeros((1, 3)), "expected an acceleration along the car"),
    ],
)
def test_what_is_no_command_is_refused_as_the_topics_refuse_it(answer: Any, said: str) -> None:
    with pytest.raises(InvalidInput, match=said):
        command_of_answer(answer)


def test_an_answer_is_an_acceleration_or_two_or_steering_throttle_and_brake() -> None:
    assert command_of_answer(np.float32(1.5)) == ("vehicle", (1.5, 0.0))
    assert command_of_answer(-2) == ("vehicle", (-2.0, 0.0))
    assert command_of_answer([-8.0, 0.5]) == ("vehicle", (-8.0, 0.5))
    assert command_of_answer(np.array([0.1, 0.0, 1.0])) == ("vehicle_control", (0.1, 0.0, 1.0))


def test_each_seat_has_a_driver_of_its_own_which_learns_where_it_is_and_sees_what_the_environment_shows(
    tmp_path: Path,
) -> None:
    begun: dict[Any, list[Begin]] = {}
    seen: list[tuple[Observation, NDArray[np.float32]]] = []

    class Mine:
        def reset(self, begin: Begin) -> None:
            begun.setdefault(self, []).append(begin)

        def act(self, observation: Observation) -> float:
            seen.append((observation, observation.of_environment()))
            return 0.5

    scenario = load_scenario(1)
    config = WorldConfig(spawn="paper", vehicle_driver="external")
    loop = Loop(World(config, [scenario], [(1, 4), (1, 5)], 2, 0))
    cockpit = Cockpit(Mine, [scenario], 2, "paper")
    ticks = DrivenLoop(loop, cockpit.answers, None, tmp_path / "log").ticks(lambda _: None)
    step = next(step for step in ticks if step.curvttc.max() < HORIZON)
    assert step.actions.vehicle is not None
    assert step.actions.vehicle.tolist() == [[0.5, 0.0]] * 2
    assert [[(b.scenario.number, b.episode) for b in each] for each in begun.values()] == [[(1, 4)], [(1, 5)]]
    assert len({each.seed for (each,) in begun.values()}) == 2
    (first, _), (second, vector) = seen[-2:]
    assert (first.curvttc, first.distance, len(first.pedestrians)) == (step.curvttc[0], step.distance[0], 1)
    assert vector.shape == (21,)
    assert vector[0] == np.float32(second.vehicle.speed)
    assert vector[20] == np.float32(step.curvttc[1])
