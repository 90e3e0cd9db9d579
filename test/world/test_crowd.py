"""Several pedestrians around one vehicle: rows of one episode that share it, and each its own draws and hand-over."""

import itertools

import numpy as np
import pytest
from world.helpers import SCENARIOS, calm, cautious, frames

from vpsci_ros.errors import InvalidInput
from vpsci_ros.parameters import build
from vpsci_ros.world import COLLISION, ENDED, GOAL, IDLE, RUNNING, World, WorldConfig
from vpsci_ros.world.crowd import FOLLOWER, CrowdConfig
from vpsci_ros.world.state import EPISODE, FINISHED, HANDED_OVER, STARTED
from vpsci_ros.world.tick import Actions

PAIRS = [(scenario, number) for number in range(6) for scenario in range(1, 9)]
FEW = PAIRS[:16]
THREE = WorldConfig(pedestrians=3)
VEHICLE = [name for name in EPISODE.names or () if name.startswith(("vehicle_", "lane_", "approach_"))]
VEHICLE += ["steer", "throttle", "brake", "route_s", "cruise_throttle", "meeting_s", "lateral_comfort"]


def history(config: WorldConfig = THREE, batch: int = 7, pairs=FEW, policy=cautious):
    """Every state and the events after it, under a policy."""
    return list(frames(World(config, SCENARIOS, pairs, batch, 1), policy))


def by_row(ticks) -> dict[tuple[int, int, int], bytes]:
    """Return all frames of each pedestrian, by scenario, number and pedestrian."""
    found: dict[tuple[int, int, int], bytes] = {}
    for state, _ in ticks:
        for record in state[state["status"] != IDLE]:
            key = int(record["scenario"]), int(record["episode"]), int(record["pedestrian"])
            found[key] = found.get(key, b"") + record.tobytes()
    return found


@pytest.fixture(scope="module")
def three():
    return history()


def spawned(config: WorldConfig, pairs=PAIRS, seed: int = 1):
    """Return the episodes as they begin, EPISODE[n, P]."""
    return World(config, SCENARIOS, pairs, len(pairs), seed).state.reshape(-1, config.pedestrians)


def test_an_episode_has_a_row_for_each_pedestrian_and_its_rows_begin_and_end_together(three):
    for state, events in three:
        rows = state.reshape(-1, 3)
        assert (rows["status"] == rows["status"][:, :1]).all()
        for kind in (STARTED, FINISHED):
            assert len(events[events["kind"] == kind]) % 3 == 0
    ended = [state for state, _ in three if (state["status"] == ENDED).any()]
    assert sum((state["status"] == ENDED).sum() for state in ended) == 3 * len(FEW)


def test_the_vehicle_is_the_same_in_all_rows_of_an_episode_to_the_bit(three):
    for state, _ in three:
        rows = state.reshape(-1, 3)
        for name in VEHICLE:
            assert rows[name].tobytes() == np.repeat(rows[name][:, :1], 3, axis=1).tobytes(), name


def test_bits_do_not_depend_on_the_batch_nor_on_threads(monkeypatch):
    config = WorldConfig(pedestrians=3, crowd=CrowdConfig(sizes=[1.0, 1.0, 2.0]))
    reference = by_row(history(config, batch=7))
    one = by_row(history(config, batch=1, pairs=FEW[:4]))
    assert one == {key: reference[key] for key in one}
    monkeypatch.setattr("vpsci_ros.world.world.PER_THREAD", 4)
    monkeypatch.setattr("vpsci_ros.world.world.SPAWNS_PER_THREAD", 4)
    monkeypatch.setattr("vpsci_ros.safety.compiled._pool.size", 3)
    assert by_row(history(config, batch=16)) == reference


@pytest.mark.parametrize("spawn", ["human", "paper"])
def test_a_pedestrian_begins_alike_however_many_others_there_are(spawn):
    several = spawned(WorldConfig(pedestrians=8, spawn=spawn))
    for count in (1, 2, 5):
        fewer = spawned(WorldConfig(pedestrians=count, spawn=spawn))
        for name in set(EPISODE.names or ()) - {"pedestrians"}:
            assert fewer[name].tobytes() == np.ascontiguousarray(several[name][:, :count]).tobytes(), name


def test_sizes_of_episodes_are_distributed_as_set_and_the_last_rows_stay_idle():
    pairs = [(scenario, number) for number in range(250) for scenario in range(1, 9)]
    state = spawned(WorldConfig(pedestrians=4, crowd=CrowdConfig(sizes=[2.0, 1.0, 1.0])), pairs)
    sizes = (state["status"] == RUNNING).sum(axis=1)
    assert np.bincount(sizes, minlength=5)[1:] / len(pairs) == pytest.approx([0.5, 0.25, 0.25, 0.0], abs=0.04)
    assert (state["pedestrians"][:, 0] == sizes).all()
    assert set(state[state["status"] == IDLE].tobytes()) == {0}


def test_a_follower_waits_until_the_first_one_has_passed_and_sets_off_after_its_delay():
    config = WorldConfig(spawn="human", pedestrians=2, crowd=CrowdConfig(group=0.0, opposite=0.0, follower=1.0))
    seen = {}
    for state, _ in frames(World(config, SCENARIOS, PAIRS, 16, 1), lambda state: (None, None)):
        rows = state.reshape(-1, 2)
        for row in rows[rows["status"][:, 0] == RUNNING]:
            seen.setdefault((int(row["scenario"][0]), int(row["episode"][0])), []).append(row.copy())
    waited, pushed = 0, []
    for ticks in seen.values():
        rows = np.array(ticks)
        leader, follower = rows[:, 0], rows[:, 1]
        assert (follower["role"] == FOLLOWER).all()
        waiting = np.isinf(follower["start_delay"])
        if not waiting[0]:
            continue
        waited += 1
        if waiting.all():
            continue
        begins = int(np.argmin(waiting))
        assert leader["pedestrian_s"][begins - 1] >= follower["pedestrian_s"][begins - 1] - 0.2
        pushed.append(np.hypot(follower["pedestrian_vx"][:begins], follower["pedestrian_vy"][:begins]).max())
        delay = follower["start_delay"][begins] - follower["frame"][begins - 1] * config.tick
        assert delay == pytest.approx(follower["follow_delay"][0], abs=1e-9)
    assert waited >= 5
    assert np.quantile(pushed, 0.9) < 0.7


def test_the_action_of_the_most_critical_row_drives_the_vehicle():
    world = World(THREE, SCENARIOS, PAIRS, 4, 1)
    actions = Actions(vehicle=np.tile([[-1.0, 0.0], [-2.0, 0.0], [-3.0, 0.0]], (4, 1)), pedestrian=np.zeros((12, 2)))
    near = np.tile([3.0, 2.0, 2.0], 4)
    world.advance(world.now.assessed(near, near, np.ones(12, bool)), actions)
    assert (world.state["vehicle_long"] == -2.0).all()  # the first of equal ones


def test_a_pedestrian_is_handed_over_by_its_own_pair_and_the_vehicle_by_any():
    world = World(THREE, SCENARIOS, PAIRS, 1, 1)
    far = np.full(3, np.inf)
    both = Actions(vehicle=np.full((3, 2), -1.0), pedestrian=np.full((3, 2), 0.5))
    events = world.advance(world.now.assessed(far, far, np.array([False, False, True])), both)
    assert events[events["kind"] == HANDED_OVER]["slot"].tolist() == [2]
    assert world.state["pedestrian_held"].tolist() == [0, 0, 1]
    assert world.state["vehicle_held"].tolist() == [1, 1, 1]


def test_the_autopilot_brakes_for_whichever_pedestrian_stands_before_it():
    config = WorldConfig(pedestrians=3, vehicle_driver="autopilot", pedestrian_driver="constant_velocity")
    braking = []
    for before in range(3):
        world = World(config, SCENARIOS, PAIRS, 1, 1)
        world.state["pedestrian_x"], world.state["vehicle_speed"] = 1e4 + 10.0 * np.arange(3), 3.0
        ahead = np.array([np.cos(world.state["vehicle_heading"][0]), np.sin(world.state["vehicle_heading"][0])])
        world.state["pedestrian_x"][before] = world.state["vehicle_x"][0] + 5.0 * ahead[0]
        world.state["pedestrian_y"][before] = world.state["vehicle_y"][0] + 5.0 * ahead[1]
        world.advance(calm(world))
        braking.append(world.state["vehicle_acceleration"][0])
    assert braking[0] < -0.4
    assert braking[1:] == [braking[0]] * 2


def test_a_collision_with_any_ends_the_episode_for_all_and_says_with_whom():
    config = WorldConfig(pedestrians=3, pedestrian_driver="autopilot", vehicle_driver="autopilot")
    world = World(config, SCENARIOS, PAIRS[:1], 1, 1)
    for name in ("x", "y"):
        world.state[f"pedestrian_{name}"][1] = world.state[f"vehicle_{name}"][1]
    events = world.advance(calm(world))
    assert world.state["outcome"].tolist() == [COLLISION] * 3
    assert world.state["struck"].tolist() == [0, 1, 0]
    assert (events[events["kind"] == FINISHED]["least_curvttc"] == 0.0).tolist() == [False, True, False]


def test_the_goal_is_reached_when_all_have_arrived():
    config = WorldConfig(pedestrians=3, pedestrian_driver="autopilot", vehicle_driver="autopilot")
    world = World(config, SCENARIOS, PAIRS[:1], 1, 1)
    world.state["vehicle_x"] += 1e3
    world.state["vehicle_goal"] = 1
    world.state["pedestrian_goal"] = [1, 0, 1]
    world.advance(calm(world))
    assert world.state["status"].tolist() == [RUNNING] * 3
    world.state["pedestrian_goal"] = 1
    world.advance(calm(world))
    assert world.state["outcome"].tolist() == [GOAL] * 3


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"pedestrians": 9}, "pedestrians = 9 is out of range; expected 1 to 8"),
        ({"pedestrians": 2, "crowd.sizes": [1.0, 0.0, 1.0]}, "crowd.sizes gives parts for up to 3 pedestrians"),
        ({"crowd.sizes": [0.0]}, "crowd.sizes: expected a part above 0"),
        ({"crowd.group": 0.7, "crowd.opposite": 0.7}, "shares that come to 1 at most, got group = 0.7"),
        ({"pedestrians": 2, "pedestrian_driver": "replay"}, "pedestrian_driver = replay"),
        ({"kinds.adult": 0.0}, "kinds: expected a part above 0"),
    ],
)
def test_parameters_that_make_no_crowd_are_refused_by_name(values, message):
    with pytest.raises(InvalidInput, match=message.replace("[", r"\[")):
        build(WorldConfig, values, "world_simulator")


def test_pedestrians_keep_apart_and_nobody_is_inside_another_for_long():
    inside, longest = {}, 0
    for state, _ in history(WorldConfig(pedestrians=6, spawn="human"), 16, FEW):
        rows = state.reshape(-1, 6)
        for i, j in itertools.combinations(range(6), 2):
            one, other = rows[:, i], rows[:, j]
            apart = np.hypot(one["pedestrian_x"] - other["pedestrian_x"], one["pedestrian_y"] - other["pedestrian_y"])
            for slot in np.flatnonzero((one["status"] == RUNNING) & (other["status"] == RUNNING) & (apart < 0.4)):
                key = int(one["scenario"][slot]), int(one["episode"][slot]), i, j
                inside[key] = inside.get(key, 0) + 1
                longest = max(longest, inside[key])
    assert longest <= 10  # ticks of 0.05 s
