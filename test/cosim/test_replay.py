"""Both agents, one at a time and fed by another engine, do in an episode of ours what they did there, to the bit."""

from collections.abc import Iterator

import numpy as np
import pytest

from vpsci_ros import Driver, Pedestrian, Vehicle, Walker
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.policy_file import Policy, load_policy
from vpsci_ros.world import RUNNING, World, WorldConfig, load_scenario
from vpsci_ros.world.crowd import CrowdConfig
from vpsci_ros.world.kinds import KindMixture
from vpsci_ros.world.loop import Loop

SEED = 7
WALKER = tuple(f"pedestrian_{name}" for name in ("x", "y", "vx", "vy"))
CAR = tuple(f"vehicle_{name}" for name in ("x", "y", "heading", "speed", "curvature", "acceleration"))
MIXED = KindMixture(adult=1.0, older=1.0, child=1.0, distracted=1.0)


@pytest.fixture(scope="module")
def weights() -> Policy:
    return load_policy("people")


def ticks(weights: Policy, scenario: int, episode: int, config: WorldConfig) -> Iterator[np.ndarray]:
    """Yield the rows of each tick at which an episode of ours runs."""
    world = World(config, [load_scenario(scenario)], [(scenario, episode)], 1, SEED)
    loop = Loop(world, agents=policies(weights, world))
    while (state := loop.step().tick.state)["status"][0] == RUNNING:
        yield state


def walker(record: np.void) -> Walker:
    return Walker(*(float(record[name]) for name in WALKER))


def car(record: np.void) -> Vehicle:
    return Vehicle(*(float(record[name]) for name in CAR))


@pytest.mark.parametrize(("scenario", "episode"), [(1, 0), (104, 2)])  # 104: parked cars hide them at first
def test_both_agents_alone_play_an_episode_of_ours_to_the_bit(weights: Policy, scenario: int, episode: int) -> None:
    pedestrian = Pedestrian(weights, seed=SEED, episode=episode, scenario=scenario)
    driver = Driver(weights, seed=SEED, episode=episode, scenario=scenario)
    own, vehicle, controlled, seen, first = pedestrian.start, driver.start, False, 0, -1
    for state in ticks(weights, scenario, episode, WorldConfig()):
        record = state[0]
        assert own == walker(record), f"frame {record['frame']}"
        assert vehicle == car(record), f"frame {record['frame']}"
        assert controlled == bool(record["controlled"])
        seen += controlled
        walk, drive = pedestrian.step(own, {"car": vehicle}), driver.step(vehicle, {"walker": own})
        own, vehicle = Walker(*walk[:4]), Vehicle(*drive[:4], drive.curvature, drive.acceleration)
        assert drive.controlled == walk.controlled
        if walk.controlled and first < 0:
            first = pedestrian.person.recorded
            assert first == driver.person.recorded >= 0, "one recorded reaction, undivided"
        controlled = walk.controlled
    assert seen > 40, "the policies have acted"


@pytest.mark.parametrize("number", [2])
def test_one_of_several_pedestrians_of_several_kinds_is_the_same_to_the_bit(weights: Policy, number: int) -> None:
    config = WorldConfig(pedestrians=3, crowd=CrowdConfig(group=0.3, opposite=0.2, follower=0.2), kinds=MIXED)
    pedestrian = Pedestrian(weights, seed=SEED, episode=5, scenario=1, config=config, number=number)
    driver = Driver(weights, seed=SEED, episode=5, scenario=1, config=config)
    own, vehicle, seen = pedestrian.start, driver.start, 0
    for state in ticks(weights, 1, 5, config):
        people = {row: walker(record) for row, record in enumerate(state)}
        assert own == people[number]
        assert vehicle == car(state[0])
        others = {row: person for row, person in people.items() if row != number}
        walk, drive = pedestrian.step(own, {"car": vehicle}, others), driver.step(vehicle, people)
        own, vehicle = Walker(*walk[:4]), Vehicle(*drive[:4], drive.curvature, drive.acceleration)
        seen += walk.controlled
    assert seen > 20
