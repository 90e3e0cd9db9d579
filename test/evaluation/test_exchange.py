"""One agent is exchanged from the onset on, and a simulator moves the other one in front of it."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.evaluation.onsets import Onsets, Other, find_onsets
from vpsci_ros.evaluation.predictors import PeoplePredictor
from vpsci_ros.evaluation.simulators import exchange, fading, policy, rolled_out
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.world.observation import AGENTS, STEP


@pytest.fixture(scope="module")
def onsets() -> Onsets:
    """Onsets of eight synthetic encounters."""
    return find_onsets(synthetic_near_misses(interactions=8, seed=3).table)


@pytest.fixture(scope="module")
def people() -> Bank:
    bank = load_policy("people")
    assert isinstance(bank, Bank)
    return bank


def speeds(positions: np.ndarray, onsets: Onsets, agent: int) -> np.ndarray:
    """Return the speed [m/s] between all steps after the first, float64[n, 29]."""
    return np.linalg.norm(np.diff(positions[:, 0, agent], axis=1), axis=-1) / STEP


@pytest.mark.parametrize("name", ["people", "closed_loop"])
@pytest.mark.parametrize("agent", AGENTS)
def test_the_recorded_agent_moves_as_recorded_whoever_moves_the_other_one(
    onsets: Onsets, name: str, agent: str
) -> None:
    simulate, part = policy(load_policy(name), 0, 2), AGENTS.index(agent)
    own, free = simulate(replace(onsets, other=Other(agent))), simulate(onsets)
    off = np.abs(own[:, :, part] - onsets.recorded[:, None, part]).max()
    assert off < 0.2, "published velocities do not lead exactly along the positions"
    assert np.abs(free[:, :, part] - onsets.recorded[:, None, part]).max() > 1.0
    assert (own[:, :, 1 - part] != free[:, :, 1 - part]).any(), "the other one sees it"


def test_an_exchanged_car_keeps_its_speed_brakes_to_a_halt_accelerates_or_stands_at_once(onsets: Onsets) -> None:
    done = {
        gain: speeds(fading(replace(onsets, other=Other("vehicle", gain))), onsets, 0) for gain in (0, -3, 2, -np.inf)
    }
    begin = done[0][:, 0]
    assert (begin > 2.0).all()
    for gain in (0, -3, 2):  # the mean speed over the second step is that after 0.15 s
        moves = begin[:, None] + gain * STEP * (1.5 + np.arange(29))
        assert done[gain] == pytest.approx(np.maximum(moves, 0.0), abs=0.08)
    assert done[-np.inf] == pytest.approx(0.0, abs=1e-6)


def test_an_exchanged_pedestrian_walks_straight_on_or_stands(onsets: Onsets) -> None:
    on = fading(replace(onsets, other=Other("pedestrian", 0.0)))[:, 0, 1]
    time = STEP * np.arange(1, 31)[:, None]
    assert on == pytest.approx(onsets.start[:, None, 5:7] + onsets.start[:, None, 7:9] * time, abs=1e-4)
    stands = fading(replace(onsets, other=Other("pedestrian", -np.inf)))[:, 0, 1]
    assert stands == pytest.approx(np.broadcast_to(stands[:, :1], stands.shape), abs=1e-5)


def test_whose_choices_are_exchanged_need_not_be_made(onsets: Onsets, people: Bank) -> None:
    there = replace(onsets, other=Other("vehicle", -3.0))
    both, one = (
        rolled_out(PeoplePredictor(people, onsets.clip, 0, "", agents), there) for agents in (AGENTS, AGENTS[1:])
    )
    assert (both == one).all()


def test_nobody_is_exchanged_by_default_and_a_part_of_the_onsets_keeps_the_exchange(onsets: Onsets) -> None:
    actions = np.zeros((8, 2), np.float32), np.ones((8, 2), np.float32)
    assert exchange(onsets)(None, actions) is actions  # type: ignore[arg-type]
    there = replace(onsets, other=Other("vehicle", 2.0), late=True).take(np.array([3, 1]))
    assert (there.other, there.late) == (Other("vehicle", 2.0), True)
    assert (there.pedestrian_first == onsets.pedestrian_first[[3, 1]]).all()
