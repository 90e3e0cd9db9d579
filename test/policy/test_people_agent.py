"""Banks: both agents act by the reaction of one of the most similar situations, chosen so that they do not touch."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.cli.parameter_file import load
from vpsci_ros.cli.people import people
from vpsci_ros.data.near_misses import MOTION, read_near_misses, write_near_misses
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.outcomes import NoAcceleration
from vpsci_ros.nodes.graph import resolve
from vpsci_ros.policy.agent import policies
from vpsci_ros.policy.bank import (
    FEATURES,
    Bank,
    Reactions,
    bank_from_bytes,
    bank_to_bytes,
    describe,
    save_bank,
    with_means,
)
from vpsci_ros.policy.choice import AGAIN, LOOKS, NEAREST, ReactionReplay
from vpsci_ros.policy.draws import keys
from vpsci_ros.policy.forecast import ACTIONS, SITUATION, Networks, forecasts, no_networks, shapes
from vpsci_ros.policy.make_bank import FOREIGN, actions_of, bank_of_tables, fitted
from vpsci_ros.policy.onset_range import beyond, onsets_in, onsets_of, range_of
from vpsci_ros.policy.people_agent import walked_in
from vpsci_ros.policy.policy_file import load_policy, policy_from_bytes
from vpsci_ros.policy.reaction import CLOSE, EVASIONS, FADES, MARGIN
from vpsci_ros.policy.tensor_file import tensors_to_bytes
from vpsci_ros.safety import CRITICAL_TTC, clearance
from vpsci_ros.world import EPISODE, RUNNING, World, WorldConfig, load_scenarios
from vpsci_ros.world.loop import Loop
from vpsci_ros.world.observation import AGENTS

APART = np.array([[2.0, -0.5, 0.1, 6.0, 9.0, 0.1, 0.5, 0.0, 0.0]])  # the pedestrian is to the left and walks away
MEETS = np.array([[5.0, np.nan, np.nan, 10.0, -2.0, 0.0, 1.0, np.nan, np.nan]])  # at the same place after 2 s
MIRROR = np.array([1, 1, -1, 1, -1, 1, -1, 1, -1])


def reactions(count: int = 80, length: int = 35, vehicle: float = 0.0) -> Reactions:
    """Situation k: `APART` at a pace more by k; the vehicle does `vehicle`, steers k / 1000, the walker does 0.01 k."""
    features = np.repeat(describe(APART)[0], count, axis=0)
    features[:, 1] += np.arange(count)
    steps = np.zeros((count, length, ACTIONS))
    steps[..., 0], steps[..., 1] = vehicle, np.arange(count)[:, None] / 1000.0
    steps[..., 2] = 0.01 * np.arange(count)[:, None]
    begin = length * np.arange(count)
    before, reach = np.tile([APART[0, 1], APART[0, 2] / APART[0, 0], 0.0, 0.0], (count, 1)), range_of(onsets_of(APART))
    return Reactions(
        features.T.copy(), np.ones(FEATURES), np.ones(count), begin, begin + length, steps.reshape(-1, 4), before,
        reach, np.zeros(count), np.zeros(count, np.int64), no_networks(), np.zeros((count, 0, ACTIONS)),
    )  # fmt: skip


def acted(own: Reactions, agent: int, situation: np.ndarray, count: int, steps: int = 1, seed: int = 7) -> np.ndarray:
    """What `count` slots do in the same situation, float64[steps, count, 2]."""
    replay, every = ReactionReplay(own, agent, count, False), np.ones(count, bool)
    situations = np.repeat(situation, count, axis=0)
    return np.stack(
        [replay.step(situations, keys(count, seed, 0, np.arange(count)), every & (k == 0), every) for k in range(steps)]
    )


def test_a_situation_and_its_mirror_image_are_alike_and_know_their_sides() -> None:
    mirrored = APART * MIRROR
    features, side = describe(np.concatenate([APART, mirrored]))
    assert features[0].tobytes() == features[1].tobytes()
    assert side.tolist() == [1.0, -1.0]
    np.testing.assert_allclose(features[0], [2.0, np.hypot(0.1, 0.5), 6.0, 9.0, 0.1, 0.5, -0.5, 0.1])


def test_each_of_the_nearest_situations_is_chosen_as_often_and_no_other() -> None:
    number = np.round(acted(reactions(), 1, APART, 4000)[0, :, 0] / 0.01).astype(int)
    counts = np.bincount(number, minlength=80)
    assert (counts[NEAREST:] == 0).all()
    assert counts[:NEAREST].min() > 4000 / NEAREST - 5 * np.sqrt(4000 / NEAREST)


def test_a_reaction_is_replayed_whole_and_another_one_follows_it() -> None:
    replay, every, along = ReactionReplay(reactions(length=35), 1, 200, False), np.ones(200, bool), []
    situations = np.repeat(APART, 200, axis=0)
    for frame in range(40):
        key = keys(200, 7, 0, np.arange(200), frame=frame)
        along.append(replay.step(situations, key, every & (frame == 0), every)[:, 0])
    first, second = np.array(along[:35]), np.array(along[35:])
    assert (first == first[0]).all()
    assert (second == second[0]).all()
    assert (first[0] != second[0]).mean() > 0.8


def test_the_one_reaction_that_does_not_touch_is_chosen() -> None:
    own = reactions(count=32)
    steps = own.steps.reshape(32, -1, ACTIONS).copy()
    steps[:, :, :] = 0.0
    steps[17, :, 0] = -4.0  # brakes: 5 m/s is gone after 3.1 m, which leaves 4 m to the pedestrian's line
    own = own._replace(steps=steps.reshape(-1, ACTIONS))
    np.testing.assert_allclose(acted(own, 0, MEETS, 200)[0, :, 0], -4.0)


def test_the_own_acceleration_goes_on_where_it_differs_from_the_recorded_one_and_fades() -> None:
    # Recorded at 2 m/s: 0.3 m/s2 and a bend of 0.05 1/m before and after, the walker 0.1 and 0.2 m/s2.
    steps = np.repeat([[0.3, 0.05, 0.1, 0.2]], 35, axis=0)
    one = reactions(1)._replace(steps=steps, before=steps[:1])
    now = APART + np.array([0, 0.5 - APART[0, 1], 0.3 - APART[0, 2], 0, 0, 0, 0, -0.3, 0.7])
    age, recorded = np.arange(AGAIN)[:, None], [[0.3, 4.0 * 0.05], [0.1, 0.2]]
    own = [[0.5, 2.0 * 0.3], [-0.3, 0.7]]  # the car's sideways one is its speed times its yaw rate
    for agent in (0, 1):
        fade = np.array(FADES[2 * agent : 2 * agent + 2]) ** age
        wanted = recorded[agent] + (np.array(own[agent]) - recorded[agent]) * fade
        np.testing.assert_allclose(acted(one, agent, now, 1, steps=AGAIN)[:, 0], wanted)


def test_what_was_done_before_is_mirrored_with_the_reaction() -> None:
    steps = np.repeat([[0.3, 0.05, 0.1, 0.2]], 35, axis=0)
    one = reactions(1)._replace(steps=steps, before=steps[:1])
    now = APART + np.array([0, 0.5, 0.3, 0, 0, 0, 0, -0.3, 0.7])
    for agent in (0, 1):
        left, right = (acted(one, agent, each, 1, steps=9)[:, 0] for each in (now, now * MIRROR))
        np.testing.assert_allclose(left * [1, -1], right)


def test_where_an_acceleration_is_not_known_the_recorded_reaction_is_replayed() -> None:
    steps = np.repeat([[0.3, 0.05, 0.1, 0.2]], 35, axis=0)
    one = reactions(1)._replace(steps=steps, before=steps[:1] + 1.0)
    now = APART.copy()
    now[0, [1, 2, 7, 8]] = np.nan
    np.testing.assert_allclose(acted(one, 0, now, 1, steps=9)[:, 0], np.repeat([[0.3, 4.0 * 0.05]], 9, axis=0))
    np.testing.assert_allclose(acted(one, 1, now, 1, steps=9)[:, 0], np.repeat([[0.1, 0.2]], 9, axis=0))


@pytest.mark.parametrize(("speed", "sideways"), [(6.0, 1.6), (3.0, 1.6), (16.0, 0.1 / 9.0 * 256.0)])
def test_a_car_of_another_speed_has_the_recorded_sideways_acceleration_up_to_a_factor(
    speed: float, sideways: float
) -> None:
    # Recorded at 4 m/s: -1 m/s2 and 0.1 1/m, that is 1.6 m/s2 sideways. At 16 m/s the factor is 3, not 4.
    recorded, now = APART.copy(), APART.copy()
    recorded[0, 0], now[0, 0], now[0, 1:3] = 4.0, speed, np.nan
    steps = np.repeat([[-1.0, 0.1, 0.3, 0.2]], 35, axis=0)
    one = reactions(1)._replace(features=describe(recorded)[0].T.copy(), steps=steps)
    np.testing.assert_allclose(acted(one, 0, now, 1)[0, 0], [-1.0, sideways])


def test_a_pedestrians_acceleration_is_that_since_the_last_policy_frame_of_the_same_episode() -> None:
    state, every = np.zeros(2, EPISODE), np.ones(2, bool)
    last, out = np.full((2, 6), -1.0), np.zeros((2, 2))
    state["scenario"], state["episode"] = 1, [3, 4]

    def after(frame: int, velocity: list[float]) -> list[list[float]]:
        state["frame"], state["pedestrian_vx"] = frame, velocity
        walked_in(state, every, last, out)
        return out[:, 0].tolist()

    assert np.isnan(after(0, [1.0, 1.0])).all(), "nothing is known at the first frame"
    assert after(2, [1.25, 0.5]) == [2.5, -5.0]
    first, jump = after(4, [1.25, 1.25])
    assert first == 0.0
    assert np.isnan(jump), "7.5 m/s2 are no pedestrian's"
    state["episode"][0] = 5
    assert np.isnan(after(6, [1.25, 1.25])[0]), "another episode has begun in the slot"


def test_an_onset_lies_beyond_the_range_where_one_of_four_does() -> None:
    # Speeds 0 to 10 m/s, 5 m ahead, walking 1 m/s straight across: quantiles of 0.25 and 9.75 m/s, 5 m, 1 m/s, 90 deg.
    seen = np.zeros((101, SITUATION))
    seen[:, 0], seen[:, 3], seen[:, 6] = np.linspace(0.0, 10.0, 101), 5.0, 1.0
    reach = range_of(onsets_of(seen))
    np.testing.assert_allclose(reach[:, [0, 2, 4]], [[0.25, 5.0, 9.75], [5.0] * 3, [1.0] * 3, [90.0] * 3])
    asked = np.array(
        [[5, 5, 1, 90], [9.8, 5, 1, 90], [5, 5.1, 1, 90], [5, 5, 0.9, 90], [5, 5, 1, 60], [5, 5, 1, np.nan]]
    )
    assert beyond(asked, reach).tolist() == [False, True, True, True, True, False]


def test_no_angle_is_beyond_the_range_of_people_who_stood() -> None:
    seen = np.zeros((50, SITUATION))
    seen[:, 0], seen[:, 3] = 4.0, 5.0
    asked = np.array([[4.0, 5.0, 0.0, angle] for angle in (0.0, 2.0, 180.0)])
    assert not beyond(asked, range_of(onsets_of(seen))).any()


def test_an_onset_of_the_map_frame_is_that_of_the_moment() -> None:
    heading, place = 0.7, np.array([3.0, 4.0])
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, -s], [s, c]])
    walk, velocity = turn @ [0.5, -1.2], 6.0 * np.array([c, s])
    situation = np.array([[6.0, 0.0, 0.0, *(turn.T @ place), 0.5, -1.2, 0.0, 0.0]])
    one, other = onsets_of(situation), onsets_in(np.zeros((1, 2)), velocity[None], place[None], walk[None])
    np.testing.assert_allclose(one, [[6.0, 5.0, 1.3, np.degrees(np.arctan2(1.2, 0.5))]])
    np.testing.assert_allclose(one, other)


def test_a_bank_of_the_format_before_is_refused_in_words() -> None:
    old = tensors_to_bytes({"here.side": np.ones(1, np.float32)}, "vpsci-people 3", {"people": ["here"]})
    with pytest.raises(InvalidInput, match="mine: expected format 'vpsci-people 4'.*make the bank again"):
        policy_from_bytes(old, "mine")


def keeps_apart(push: tuple[float, float, float], steps: int) -> bool:
    """Whether `MEETS` at constant velocities, and a constant `push`, stays more than `MARGIN` apart."""
    car, speed, walker, velocity = 0.0, 5.0, MEETS[0, 3:5].copy(), MEETS[0, 5:7].copy()
    for _ in range(steps):
        car, speed = car + 0.1 * speed + 0.005 * push[0], speed + 0.1 * push[0]
        last, slows = velocity.copy(), np.dot(push[1:], velocity) < 0.0
        if slows or np.dot(push[1:], MEETS[0, 5:7]) >= 0.0:
            velocity += 0.1 * np.array(push[1:])
        walker += 0.05 * (last + velocity)
        if clearance(car, 0.0, 0.0, *walker) <= MARGIN:
            return False
    return True


def test_where_every_reaction_leads_to_contact_the_driver_adds_the_least_acceleration_that_keeps_apart() -> None:
    pushes = [(way, 0.0, 0.0) for strength in EVASIONS for way in (-2.0 * strength, strength)]
    least = next(push for push in pushes if keeps_apart(push, 30))
    one = reactions(1)._replace(steps=np.zeros((35, ACTIONS)))
    np.testing.assert_allclose(acted(one, 0, MEETS, 1)[0, 0], (least[0], 0.0))
    assert 0.0 < abs(least[0]) < 8.0
    assert (acted(one, 1, MEETS, 1)[0, 0] == 0.0).all(), "the pedestrian leaves it to the driver, whose way is enough"


def test_a_pedestrian_evades_too_where_the_driver_alone_cannot() -> None:
    late = MEETS + np.array([5.0, 0, 0, -1.0, 1.7, 0, 0, 0, 0])  # 10 m/s, the front 6.7 m before its line, on the line
    one = reactions(1)._replace(steps=np.zeros((35, ACTIONS)))
    assert acted(one, 0, late, 1)[0, 0, 0] != 0.0
    assert np.abs(acted(one, 1, late, 1)[0, 0]).max() >= EVASIONS[0]


def test_a_car_that_deviates_from_the_chosen_reaction_is_expected_to_do_what_it_does() -> None:
    # In every reaction both keep apart, since the vehicle brakes. The car that is met does not. Once it has deviated
    # by LEFT, after two steps, its acceleration is expected to go on, and the pedestrian evades as soon as it sees
    # contact within LOOKS steps; before a car that brakes as chosen it never does.
    own = reactions(count=32)
    steps = np.zeros((32, 35, ACTIONS))
    steps[:, :, 0] = -4.0
    own = own._replace(steps=steps.reshape(-1, ACTIONS))
    replay, every, evades = ReactionReplay(own, 1, 1, False), np.ones(1, bool), {}
    for braking in (0.0, -4.0):
        x, y, speed, evades[braking] = 10.0, -2.0, 5.0, []
        for frame in range(12):
            situation = np.array([[speed, braking, 0.0, x, y, 0.0, 1.0, 0.0, 0.0]])
            done = replay.step(situation, keys(1, 7, 0, 0, frame=frame), every & (frame == 0), every)
            evades[braking].append(bool(np.abs(done).max() > 0.0))
            x, y, speed = x - 0.1 * speed - 0.005 * braking, y + 0.1, max(0.0, speed + 0.1 * braking)
    first = evades[0.0].index(True)
    assert 20 - LOOKS[1] - 6 <= first <= 20 - LOOKS[1], "the centres meet after 20 steps, the footprints earlier"
    assert not any(evades[-4.0])


def test_a_pedestrian_keeps_its_half_where_another_drivers_half_avoids_contact() -> None:
    # In no reaction but one the vehicle brakes; what the pedestrian does is recorded with vehicles that do not.
    own = reactions(count=8)
    steps = np.zeros((8, 35, ACTIONS))
    steps[:, :, 2] = 0.001 * np.arange(1, 9)[:, None]
    steps[5, :, 0] = -4.0
    own = own._replace(steps=steps.reshape(-1, ACTIONS))
    walkers = np.round(acted(own, 1, MEETS, 2000)[0, :, 0] / 0.001).astype(int)
    assert np.bincount(walkers, minlength=9)[1:].min() > 2000 / 8 - 5 * np.sqrt(2000 / 8)
    np.testing.assert_allclose(acted(own, 0, MEETS, 50)[0, :, 0], -4.0)


def networks(count: int = 5, width: int = 8) -> Networks:
    rng = np.random.default_rng(2)
    return Networks(*(0.1 * rng.standard_normal((count, *shape)) for shape in shapes(width)))


def test_a_forecast_is_the_networks_output_and_counts_an_unknown_acceleration_as_none() -> None:
    made, numbers = networks(), np.array([3, 0])
    now = np.concatenate([APART, MEETS])
    for number, situation, found in zip(numbers, now, forecasts(made, numbers, now), strict=True):
        entry, entry_bias, inner, inner_bias, out, out_bias = (array[number] for array in made)
        hidden = np.maximum(np.maximum(np.nan_to_num(situation) @ entry + entry_bias, 0.0) @ inner + inner_bias, 0.0)
        np.testing.assert_allclose(found, (hidden @ out + out_bias).reshape(30, ACTIONS))


def test_a_reaction_adds_half_of_what_the_forecasts_differ_by() -> None:
    own = with_means(reactions(1)._replace(networks=networks(), unseen_by=np.array([2]), features=describe(APART)[0].T))
    now = APART + np.array([1.0, 0.2, 0, 0.5, 0, 0, 0.3, 0.1, 0])
    before = APART.copy()
    before[0, [1, 2, 7, 8]] = own.before[0]
    before[0, 2] *= APART[0, 0]
    more = forecasts(own.networks, np.array([0]), now)[0] - forecasts(own.networks, np.array([2]), before)[0]
    fade = 0.5 * np.array([[0.1 * FADES[2] ** k, 0.0] for k in range(5)])  # half of the own acceleration, which fades
    np.testing.assert_allclose(acted(own, 1, now, 1, steps=5)[:, 0], 0.5 * more[:5, 2:] + fade, atol=1e-6)


@pytest.mark.parametrize("agent", [0, 1])
def test_what_acted_in_a_slot_before_changes_nothing_after_a_hand_over(agent: int) -> None:
    """Also where the reaction begins at the bank's first step, as in an empty slot and after the same reaction."""
    left = []
    for was in (0, 7):
        replay, every = ReactionReplay(reactions(count=1), agent, 1, False), np.ones(1, bool)
        replay.slots["begin"], replay.slots["expected"], replay.slots["apart"] = was, 99.0, 99.0
        for step in range(3):
            replay.step(APART, keys(1, 7, 0, np.arange(1)), every & (step == 0), every)
        left.append(replay.slots.tobytes())
        assert replay.slots["apart"][0] < 0.5
    assert left[0] == left[1]


def test_a_row_has_the_same_bits_in_any_batch() -> None:
    own, rng = load_policy("people").of(), np.random.default_rng(1)
    situations = np.concatenate([APART, MEETS] * 20) + 0.2 * rng.normal(size=(40, SITUATION))
    key, every = keys(40, 3, 1, np.arange(40)), np.ones(40, bool)
    whole = ReactionReplay(own, 1, 40, True).step(situations, key, every, every)
    for row in (0, 7, 39):
        part = ReactionReplay(own, 1, 1, True).step(situations[[row]], key[[row]], every[:1], every[:1])
        assert part.tobytes() == whole[[row]].tobytes()


def test_a_bank_comes_back_from_its_file_and_damage_is_refused(tmp_path: Path) -> None:
    learned = reactions()._replace(networks=networks(), unseen_by=1 + np.arange(80) % 4)
    bank = Bank({"here": learned}, {"data": {"clips": 3}})
    save_bank(tmp_path / "own.safetensors", bank)
    again = load_policy(tmp_path / "own.safetensors")
    assert isinstance(again, Bank)
    assert again.facts["data"] == {"clips": 3}
    for one, other in zip(again.of("here")[:-2], bank.of("here")[:-2], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)
    np.testing.assert_allclose(again.of("here").networks.exit, bank.of("here").networks.exit, rtol=1e-6)
    np.testing.assert_allclose(again.of("here").means, with_means(bank.of("here")).means, rtol=1e-4, atol=1e-6)
    data = bytearray(bank_to_bytes(bank))
    data[-1] ^= 1
    with pytest.raises(InvalidInput, match="its tensors are not those it was written with"):
        bank_from_bytes(bytes(data))
    with pytest.raises(InvalidInput, match="expected one of here, the sources of this bank, got 'vci'"):
        bank.of("vci")
    with pytest.raises(InvalidInput, match="do not fit together"):
        bank_from_bytes(bank_to_bytes(Bank({"here": reactions()._replace(end=np.full(80, 9999))})))
    with pytest.raises(InvalidInput, match="do not fit together"):
        bank_from_bytes(bank_to_bytes(Bank({"here": learned._replace(unseen_by=np.full(80, 5))})))


def test_situations_of_another_place_serve_where_the_own_place_has_none_alike() -> None:
    # Situation k is k from `APART`. The first forty are of another place, and count as 100 further away.
    far = np.where(np.arange(80) < 40, 100.0**2, 0.0)
    own = reactions()._replace(far=far)
    number = np.round(acted(own, 1, APART, 4000)[0, :, 0] / 0.01).astype(int)
    counts = np.bincount(number, minlength=80)
    assert np.flatnonzero(counts).tolist() == [*range(24), *range(40, 80)], "forty own ones, and 24 to make 64"


def test_a_bank_of_one_place_with_another_keeps_its_name_and_counts_the_other_as_further_away(tmp_path: Path) -> None:
    mine = synthetic_near_misses(interactions=12, seed=3).table
    write_near_misses(mine, tmp_path / "mine.parquet")
    theirs = synthetic_near_misses(interactions=12, seed=4).table.with_columns(source=pl.lit("elsewhere"))
    write_near_misses(theirs, tmp_path / "theirs.parquet")
    ((name, alone),) = bank_of_tables([tmp_path / "mine.parquet"]).reactions.items()
    ((same, both),) = bank_of_tables(
        [tmp_path / "mine.parquet"], others=[tmp_path / "theirs.parquet"]
    ).reactions.items()
    assert same == name
    assert (alone.far == 0.0).all()
    assert int((both.far == 0.0).sum()) == len(alone.side)
    assert set(both.far) == {0.0, FOREIGN**2}
    write_near_misses(theirs.with_columns(source=pl.lit(f"{name}-again")), tmp_path / "again.parquet")
    with pytest.raises(InvalidInput, match=f"expected another source than {name}"):
        bank_of_tables([tmp_path / "mine.parquet"], others=[tmp_path / "again.parquet"])


def test_a_situation_without_a_step_before_has_the_acceleration_of_its_own_step(tmp_path: Path) -> None:
    table = synthetic_near_misses(interactions=12, seed=3).table
    first = (pl.col("curvttc") < CRITICAL_TTC).arg_max().over("interaction")
    cut = table.filter(pl.int_range(pl.len()).over("interaction") >= first)
    write_near_misses(cut, tmp_path / "cut.parquet")
    ((_, own),) = bank_of_tables([tmp_path / "cut.parquet"]).reactions.items()
    assert np.isfinite(own.before).all()
    track = cut.filter(pl.col("interaction") == cut["interaction"][0]).select(MOTION).to_numpy()
    assert own.before[0, 0] == actions_of(track)[0, 0]


def test_a_bank_of_one_near_miss_acts(tmp_path: Path) -> None:
    table = synthetic_near_misses(interactions=12, seed=3).table
    write_near_misses(table.filter(pl.col("interaction") == 1), tmp_path / "one.parquet")
    own = bank_of_tables([tmp_path / "one.parquet"]).of()
    for agent in (0, 1):
        assert np.isfinite(acted(own, agent, np.concatenate([APART, MEETS]).repeat(4, 0), 8, steps=40)).all()


def test_agents_that_touch_are_never_as_far_apart_as_those_whose_clearance_is_skipped() -> None:
    east, north = np.meshgrid(np.linspace(-4.0, 4.0, 401), np.linspace(-4.0, 4.0, 401))
    touch = clearance(0.0, 0.0, 0.0, east.ravel(), north.ravel()) <= MARGIN
    furthest = np.hypot(east.ravel(), north.ravel())[touch].max()
    assert CLOSE - 0.1 < furthest < CLOSE


def test_the_command_lists_a_bank_and_what_it_cannot_do_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    people(["people"])
    out = capsys.readouterr().out
    assert "cqut: " in out
    assert "vci: " in out
    assert out.count("walking speed [m/s]") == 2
    with pytest.raises(InvalidInput, match="closed_loop: expected a bank"):
        people(["closed_loop"])
    with pytest.raises(InvalidInput, match="name its file by -o"):
        people(["people"], others=[tmp_path])


def test_recorded_actions_lead_along_the_recorded_way() -> None:
    table = read_near_misses("right_turns/train")
    tracks = [part.select(MOTION).to_numpy() for part in table.partition_by("interaction", maintain_order=True)[:20]]
    fits = [fitted(track) for track in tracks]
    gap = np.concatenate([np.hypot(*(fit - track)[:, :2].T) for fit, track in zip(fits, tracks, strict=True)])
    assert np.quantile(gap, 0.95) < 0.05  # [m]; noise of the positions is 1 to 2 cm
    assert max(np.abs(actions_of(fit)[:, 0]).max() for fit in fits) < 6.0


def test_the_shipped_bank_knows_right_turns_and_the_campus_and_holds_no_clip_to_measure_on() -> None:
    bank = load_policy("people")
    assert isinstance(bank, Bank)
    assert list(bank.reactions) == ["cqut", "vci"]
    assert bank.facts["data"]["interactions"] == 878
    held = bank.facts["data"]["held_out_clips"]
    assert sum(clip.startswith("vci") for clip in held) == 9
    assert sum(clip.startswith("cqut-pvi/dev/") for clip in held) == len(held) - 9 > 100


def test_shipped_people_hardly_ever_collide() -> None:
    # 127 of 128 episodes are critical; at most 0.2% of such collide (README's interval): more than 2, p < 0.003.
    config = WorldConfig(spawn="right_turns", episode_time=20.0)
    world = World(config, load_scenarios(range(1, 9)), [(s, e) for e in range(16) for s in range(1, 9)], 128, 5)
    struck = 0
    for step in Loop(world, agents=policies(load_policy("people"), world)):
        struck += int(step.tick.state["struck"][step.tick.state["status"] != RUNNING].sum())
    assert struck <= 2


def test_a_car_that_does_not_steer_keeps_its_lane_also_where_the_lane_is_left_to_the_policy() -> None:
    def told(keeping: bool, learned: bool) -> bytes:
        config = WorldConfig(spawn="paper", episode_time=6.0, lane_following=keeping)
        world = World(config, load_scenarios([1]), [(1, e) for e in range(4)], 4, 5)
        agents = policies(load_policy("people"), world) if learned else dict.fromkeys(AGENTS, NoAcceleration())
        steps = [step.tick.state.tobytes() for step in Loop(world, agents=agents)]
        return b"".join(steps)

    for learned in (True, False):
        assert told(False, learned) == told(True, learned)


def test_the_graph_keeps_the_lane_of_a_bank_and_leaves_that_of_networks_to_them(tmp_path: Path) -> None:
    sections = load(Path("stage3_generate")).changed("world_simulator", {"lane_following": False})
    for weights, keeps in (("people", True), ("closed_loop", False)):
        resolved = resolve(sections.changed("vehicle_policy", {"weights": weights}), tmp_path)
        assert resolved.values["world_simulator"]["lane_following"] is keeps
