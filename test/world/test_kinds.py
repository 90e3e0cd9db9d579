"""Kinds of pedestrian: drawn by the mixture, as fast as their table says, and as late."""

import numpy as np
import pytest
from world.helpers import SCENARIOS, alarm

from vpsci_ros.world import World, WorldConfig
from vpsci_ros.world.kinds import KINDS, LATENCY, REACTING, SPEED, SPEED_SPREAD, KindMixture
from vpsci_ros.world.tick import Actions

PAIRS = [(scenario, number) for number in range(250) for scenario in range(1, 9)]


def spawned(mixture: KindMixture, spawn: str = "human"):
    return World(WorldConfig(kinds=mixture, spawn=spawn), SCENARIOS, PAIRS, len(PAIRS), 1).state


def only(kind: str) -> KindMixture:
    return KindMixture(**{name: float(name == kind) for name in KINDS})


@pytest.mark.parametrize("spawn", ["human", "paper"])
def test_adults_alone_are_the_world_without_kinds_to_the_bit(spawn):
    plain = spawned(KindMixture(), spawn)
    assert plain.tobytes() == spawned(KindMixture(adult=5.0), spawn).tobytes()
    mixed = spawned(KindMixture(older=1.0), spawn)
    adults = mixed["kind"] == 0
    assert 0.4 < adults.mean() < 0.6
    assert mixed[adults].tobytes() == plain[adults].tobytes()


def test_kinds_are_as_frequent_as_the_mixture_says():
    state = spawned(KindMixture(adult=4.0, older=2.0, child=1.0, distracted=1.0, wheelchair=1.0, stroller=1.0))
    shares = np.bincount(state["kind"], minlength=len(KINDS)) / len(state)
    assert shares == pytest.approx([0.4, 0.2, 0.1, 0.1, 0.1, 0.1], abs=0.03)


@pytest.mark.parametrize("kind", KINDS[1:])
def test_speeds_latencies_and_shares_of_a_kind_follow_its_table(kind):
    state, k = spawned(only(kind)), KINDS.index(kind)
    error = 4.0 * SPEED_SPREAD[k] / np.sqrt(len(state))
    assert state["walking_speed"].mean() == pytest.approx(SPEED[k], abs=error)
    assert state["walking_speed"].std() == pytest.approx(SPEED_SPREAD[k], rel=0.15)
    reacts = np.isfinite(state["reaction_delay"])
    assert reacts.mean() == pytest.approx(REACTING[k], abs=0.04)
    assert np.median(state["reaction_delay"][reacts]) == pytest.approx(LATENCY[k], rel=0.08, abs=1e-12)


@pytest.mark.parametrize(("delay", "moved_after"), [(0.0, 0), (0.5, 5), (np.inf, None)])
def test_a_policy_moves_a_pedestrian_only_when_it_reacts(delay, moved_after):
    world = World(WorldConfig(spawn="human"), SCENARIOS, [(1, 0)], 1, 1)
    world.state["reaction_delay"] = delay
    stop = Actions(vehicle=np.zeros((1, 2)), pedestrian=np.array([[0.0, 3.0]]))
    held = []
    while world.now.number < 30:
        frame = world.now.policy_frame[0]
        world.advance(alarm(world), stop)
        if frame:
            held.append(int(world.state["pedestrian_held"][0]))
    assert held == ([0] * 15 if moved_after is None else [0] * moved_after + [1] * (15 - moved_after))
