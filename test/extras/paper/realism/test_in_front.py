"""Who goes first, least clearance, and one agent in front of another one that does not see it."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from extras.paper.realism.straight import constant_velocity
from synthetic import synthetic_near_misses

from vpsci_ros.evaluation.onsets import Onsets, find_onsets
from vpsci_ros.evaluation.statistics import cluster_counts
from vpsci_ros.extras.paper.realism.controls import APART, SAMPLER
from vpsci_ros.extras.paper.realism.forecasts import forecasts
from vpsci_ros.extras.paper.realism.in_front import EXCHANGES, answers, front, recorded_answers
from vpsci_ros.extras.paper.realism.measure_realism import _counts, _range
from vpsci_ros.extras.paper.realism.order import crps, difference, estimate, least_clearance, pedestrian_first, scores
from vpsci_ros.extras.paper.realism.same_start import SameStart
from vpsci_ros.extras.paper.rule_based import rule_based
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.world.observation import AGENTS


def copies(motion: np.ndarray, onsets: Onsets) -> Onsets:
    """Return the first onset with another motion, float64[31, 9], from the onset on."""
    one = onsets.take(np.array([0]))
    return replace(one, interactions=replace(one.interactions, motion=motion[None], first=np.array([0])))


def crossing(speed: float, pace: float) -> np.ndarray:
    """Return a car from 12 m before a crossing point, and a pedestrian from 4 m before it, float64[31, 9]."""
    t = 0.1 * np.arange(31)
    zero = np.zeros(31)
    return np.stack([-12 + speed * t, zero, zero, zero + speed, zero, zero, -4 + pace * t, zero, zero + pace], axis=1)


@pytest.mark.parametrize(("speed", "pace", "first"), [(1.5, 1.5, 1.0), (3.0, 0.9, 0.0), (0.2, 0.0, 0.5)])
def test_roll_outs_go_on_at_their_velocity_until_it_shows_who_goes_first(
    onsets: Onsets, speed: float, pace: float, first: float
) -> None:
    """After 3 s the car is 7.5, 3 and 11.4 m, the pedestrian -0.5, 1.3 and 4 m before the crossing point."""
    own = copies(crossing(speed, pace), onsets)
    assert pedestrian_first(own.recorded[:, None], own) == pytest.approx([first])


def test_the_least_clearance_is_that_between_the_footprints(onsets: Onsets) -> None:
    own = copies(crossing(2.0, 0.0), onsets)  # ends 6 m before the point, with the pedestrian 4 m aside
    length, width = own.size[0]
    apart = np.hypot(6.0 - 0.5 * length, 4.0 - 0.5 * width) - 0.3
    assert least_clearance(own.recorded[:, None], own)[0, 0] == pytest.approx(apart, abs=0.01)


def test_the_crps_by_hand() -> None:
    # errors 1, 2, 4; distances of pairs 1, 2, 3: 7/3 - 2/2
    assert crps(np.array([[1.0, 2.0, 4.0]]), np.zeros(1)) == pytest.approx([7 / 3 - 1.0])
    assert crps(np.array([[3.0]]), np.zeros(1)) == pytest.approx([3.0])


def test_a_recording_in_front_of_itself_is_perfect_but_for_who_goes_first_after_three_seconds(onsets: Onsets) -> None:
    for agent in AGENTS:
        found = front(onsets, lambda own: own.recorded[:, None], agent)
        for name in ("energy", "crps", "off"):
            assert found[name] == pytest.approx(0.0, abs=1e-9)
    known = ~np.isnan(onsets.pedestrian_first)
    assert known.any()
    assert np.isnan(found["brier"][~known]).all()
    assert found["brier"][known].mean() < 0.1


def test_the_other_one_is_the_recorded_one_whatever_the_simulator_makes_it_do(onsets: Onsets) -> None:
    def away(own: Onsets) -> np.ndarray:
        out = constant_velocity(own)
        out[:, :, 0] += 50.0
        return out

    plain, moved = (front(onsets, simulate, "pedestrian") for simulate in (constant_velocity, away))
    for name in ("energy", "brier", "crps", "contact"):
        np.testing.assert_array_equal(plain[name], moved[name])
    assert plain["energy"] == pytest.approx(scores(constant_velocity(onsets), onsets, "pedestrian")["energy"])
    assert (moved["off"] > 40.0).all()


def test_a_rule_based_pedestrian_sees_the_exchanged_car(onsets: Onsets) -> None:
    found = answers(onsets, rule_based, "pedestrian")
    assert (found["stands"]["change"] != found["keeps_speed"]["change"]).any()
    assert (front(onsets, rule_based, "pedestrian")["off"] < 0.2).all()


def test_who_does_not_look_answers_nothing_and_who_does_answers_what_the_other_one_did(onsets: Onsets) -> None:
    def waits(own: Onsets) -> np.ndarray:
        """Stands where the car keeps its speed, and walks on otherwise."""
        out = constant_velocity(own)
        if own.other is not None and own.other.acceleration == 0.0:
            out[:, :, 1] = out[:, :, 1, :1]
        return out

    blind, sees = (answers(onsets, simulate, "pedestrian") for simulate in (constant_velocity, waits))
    assert list(sees) == list(EXCHANGES["pedestrian"])
    for name in blind:
        assert blind[name]["slower"] == pytest.approx(0.0)
        assert blind[name]["change"] == pytest.approx(0.0, abs=1e-6)
    assert sees["keeps_speed"]["slower"] == pytest.approx(1.0)
    assert sees["keeps_speed"]["change"] == pytest.approx(-np.hypot(*onsets.start[:, 7:9].T), abs=1e-6)
    assert sees["brakes"]["slower"] == pytest.approx(0.0)
    draws = cluster_counts(onsets.units.labels, 0)
    assert difference(sees["keeps_speed"]["slower"], sees["brakes"]["slower"], draws) == pytest.approx([1.0, 1.0, 1.0])


def test_recorded_answers_are_sorted_by_what_the_car_then_did(onsets: Onsets) -> None:
    motion = onsets.interactions.motion.copy()
    rows, first = np.arange(len(onsets)), onsets.interactions.first
    speed = np.hypot(*motion[rows, first, 3:5].T)
    gains = np.resize([0.0, -1.5, 1.0, -100.0, -0.6], len(onsets))  # [m/s2]; the last is none of them
    later = np.maximum(speed + 1.5 * gains, 0.0)
    motion[rows, first + 15, 3], motion[rows, first + 15, 4] = later, 0.0
    found = recorded_answers(replace(onsets, interactions=replace(onsets.interactions, motion=motion)), "pedestrian")
    sorted_as = {name: ~np.isnan(own["slower"]) for name, own in found.items()}
    assert (sorted_as["keeps_speed"] == (gains == 0.0)).all()
    assert (sorted_as["accelerates"] == (gains == 1.0)).all()
    assert (sorted_as["stands"] >= (gains == -100.0)).all()
    assert not np.any([own[gains == -0.6] for own in sorted_as.values()] & (later[gains == -0.6] > 0.3))


def test_a_mean_leaves_out_what_is_not_known_and_is_nan_where_nothing_is() -> None:
    draws = cluster_counts(np.arange(4), 0)
    values = np.array([1.0, np.nan, 3.0, 2.0])
    mean, low, high = estimate(values, draws)
    assert mean == pytest.approx(2.0)
    assert 1.0 <= low < mean < high <= 3.0
    assert estimate(values, draws, np.full(4, 4.0))[0] == pytest.approx(0.5)
    assert np.isnan(estimate(np.full(4, np.nan), draws)).all()


def test_forecasts_are_made_from_other_clips_and_a_regression_learns_what_the_features_tell(onsets: Onsets) -> None:
    slow = np.hypot(*onsets.start[:, 3:5].T) < np.median(np.hypot(*onsets.start[:, 3:5].T))
    told = replace(onsets, pedestrian_first=slow.astype(float))
    found = forecasts(told, told, 0)
    count = len(onsets)
    assert found["base_rate"] == pytest.approx((slow.sum() - slow) / (count - 1)), "without one's own clip"
    brier = {name: ((share - slow) ** 2).mean() for name, share in found.items()}
    assert brier["logistic"] < 0.5 * brier["base_rate"]
    assert "logistic" not in forecasts(told, replace(told, pedestrian_first=np.ones(count)), 0)
    unknown = forecasts(told, replace(told, pedestrian_first=np.full(count, np.nan)), 0)
    assert unknown == {"base_rate": pytest.approx(np.full(count, 0.5)), "donors": pytest.approx(np.full(count, 0.5))}


def test_donors_that_lead_to_contact_are_left_out_of_the_sampler(onsets: Onsets) -> None:
    measured = SameStart(onsets, onsets, 0)
    sampled, apart = (measured.controls()[name](onsets) for name in (SAMPLER, APART))
    assert apart.shape == sampled.shape
    every, kept, before = (
        least_clearance(own, onsets) <= 0.0 for own in (measured.sampler(onsets, len(onsets)), apart, sampled)
    )
    needed = np.maximum(apart.shape[1] - (~every).sum(axis=1), 0)  # touching ones, where there are too few others
    assert (kept.sum(axis=1) == needed).all()
    assert 0 < needed.sum() < before.sum()


def test_what_cannot_be_measured_is_counted() -> None:
    table = synthetic_near_misses(interactions=8, seed=3).table
    step, number = pl.int_range(pl.len()).over("interaction"), pl.col("interaction")
    onset = (pl.col("curvttc_causal") < 5.0).arg_max().over("interaction")
    cut = table.filter(~((number == 0) & (step > onset + 30)) & ~((number == 1) & (step < onset)))
    cut = cut.filter(~((number == 0) & (step == onset + 30)))
    cut = cut.with_columns(curvttc_causal=pl.when(number == 3).then(9.0).otherwise("curvttc_causal"))
    before, after = (_counts(of, find_onsets(of)) for of in (table, cut))
    assert (after["recordings"], after["never_critical"], after["end_within_3s"]) == (8, 1, 1)
    assert after["without_step_before"] == before["without_step_before"] + 1
    assert find_onsets(cut).number.tolist() == [1, 2, 4, 5, 6, 7]


def test_situations_of_a_bank_without_accelerations_are_counted(onsets: Onsets) -> None:
    bank = load_policy("people")
    assert isinstance(bank, Bank)
    assert _range(bank, onsets, "cqut")["unknown_accelerations"] == 0
    own = bank.of("cqut")
    before = own.before.copy()
    before[:5] = np.nan
    found = _range(Bank({"cqut": own._replace(before=before)}), onsets, "cqut")
    assert (found["unknown_accelerations"], found["situations"]) == (5, len(own.side))
