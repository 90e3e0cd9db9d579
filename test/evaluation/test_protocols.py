import numpy as np
import polars as pl
import pytest

from vpsci_ros.data.corpus import table_hash
from vpsci_ros.data.interactions import from_table
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.predictors import FadingAcceleration, PolicyPredictor, RepeatVelocity
from vpsci_ros.evaluation.protocols import (
    closed_loop,
    constant_velocity_reconstruction,
    eligible,
    horizon,
    known_actions,
    reconstruct,
)
from vpsci_ros.world.observation import AGENTS


def straight(steps=40, acceleration=0.0, critical=slice(12, 36)):
    """One interaction: a car eastwards, speeding up, and a pedestrian walking north."""
    time = 0.1 * np.arange(steps)
    speed = 5.0 + acceleration * time
    curvttc = np.full(steps, np.inf)
    curvttc[critical] = 2.0
    columns = {"veh_x": 5.0 * time + 0.5 * acceleration * time**2, "veh_y": 0.0 * time, "veh_heading": 0.0 * time}
    columns |= {"veh_speed": speed, "veh_vx": speed, "veh_vy": 0.0 * time}
    columns |= {"ped_x": 0.0 * time + 20.0, "ped_y": 1.5 * time, "ped_vx": 0.0 * time, "ped_vy": 0.0 * time + 1.5}
    head = {
        "interaction": [0] * steps,
        "source": ["made"] * steps,
        "clip": ["a"] * steps,
        "group": [0] * steps,
        "step": range(steps),
        "time": time,
    }
    return from_table(pl.DataFrame(head | columns | {"curvttc": curvttc}))


class Recall:
    """Answers with the recorded accelerations, which it was given."""

    def __init__(self, interactions, start):
        self.actions = [interactions.action[agent] for agent in AGENTS]
        self.step = start.copy()
        self.tracked_steps = 0

    def begin(self, count):
        self.rows = np.arange(count)

    def act(self, vehicle, pedestrian, curvttc, active):
        at = np.minimum(self.step, self.actions[0].shape[1] - 1)
        self.step = self.step + active
        return tuple(actions[self.rows, at] for actions in self.actions)

    def executed(self, actions, active):
        pass


def test_recorded_actions_and_next_speeds_fit_equations_8_and_9(near_misses):
    interactions = from_table(near_misses)
    for agent in AGENTS:
        predicted = interactions.observation[agent][..., :2] + 0.1 * interactions.action[agent]
        acted = interactions.acted
        np.testing.assert_allclose(predicted[acted], interactions.next_velocity[agent][acted], atol=1e-4)


def test_the_recorded_accelerations_have_no_error_in_either_protocol(near_misses):
    interactions = eligible(from_table(near_misses))
    start = np.maximum(interactions.first - 10, 0)
    perfect = reconstruct(Recall(interactions, start), interactions)
    assert perfect.ade.max() < 1e-6
    smooth = straight(acceleration=0.5)
    loop = closed_loop(Recall(smooth, np.maximum(smooth.first - 10, 0)), smooth)
    assert loop.ade.max() < 1e-4


def test_keeping_the_velocity_of_an_accelerating_car_errs_as_physics_says():
    """Over 2.3 s (steps 12 to 35) at 0.5 m/s2: half of 0.5 m/s2 times t squared; nothing for the pedestrian."""
    interactions = straight(acceleration=0.5)
    assert horizon(interactions).tolist() == [23]
    errors = closed_loop(RepeatVelocity(), interactions)
    time = 0.1 * np.arange(1, 24)
    np.testing.assert_allclose(errors.ade[0], [np.mean(0.25 * time**2), 0.0], atol=1e-6)
    np.testing.assert_allclose(errors.fde[0], [0.25 * 2.3**2, 0.0], atol=1e-6)
    assert errors.rmse()["v_veh_long"] == pytest.approx(np.sqrt(np.mean((0.5 * time) ** 2)), abs=1e-6)


def test_repeating_the_last_velocity_lags_one_step_behind():
    interactions = straight(acceleration=0.5)
    errors = reconstruct(RepeatVelocity(), interactions)
    lag = 0.1 * 0.5 * 0.1 * np.arange(1, 24)
    np.testing.assert_allclose(errors.ade[0], [lag.mean(), 0.0], atol=1e-6)
    held = constant_velocity_reconstruction(interactions)
    np.testing.assert_allclose(held.fde[0, 0], 0.1 * np.sum(0.05 * np.arange(1, 24)), atol=1e-6)


def test_a_repeated_acceleration_has_no_error_where_it_is_constant_and_a_fading_one_what_is_left() -> None:
    interactions = straight(acceleration=0.5)
    repeated = closed_loop(FadingAcceleration((1.0, 1.0)), interactions)
    np.testing.assert_allclose(repeated.ade, 0.0, atol=1e-4)
    errors = closed_loop(FadingAcceleration((0.9, 0.9)), interactions)
    lost = 0.5 * (1.0 - 0.9 ** np.arange(1, 24))  # [m/s2] at each step
    speed = 0.1 * np.cumsum(lost)
    np.testing.assert_allclose(errors.fde[0], [0.1 * (np.sum(speed) - 0.5 * speed[-1]), 0.0], atol=1e-4)
    once = reconstruct(FadingAcceleration((1.0, 1.0)), interactions)
    np.testing.assert_allclose(once.ade, 0.0, atol=1e-4)


def test_a_sensor_knows_the_mean_of_four_accelerations_that_ended_two_steps_before() -> None:
    interactions = straight(acceleration=0.5)
    interactions.action["vehicle"][0, :, 0] = np.arange(interactions.motion.shape[1])
    now, known = known_actions(interactions, np.array([9]))
    assert (now["vehicle"][0, 0], known[0]) == (9.0, True)
    late, _ = known_actions(interactions, np.array([9]), late=True)
    assert late["vehicle"][0, 0] == np.mean([4, 5, 6, 7])
    first, known = known_actions(interactions, np.array([3]), late=True)
    assert (first["vehicle"][0, 0], known[0]) == (0.5, True), "of steps 0 and 1, all that there are"
    assert known_actions(interactions, np.array([1]), late=True)[1].tolist() == [False]
    assert known_actions(interactions, np.array([-1]))[1].tolist() == [False]


def test_closed_loop_lasts_three_seconds_at_most():
    assert horizon(straight(steps=90, critical=slice(5, 80))).tolist() == [30]


def test_interactions_shorter_than_a_second_are_left_out():
    with pytest.raises(InvalidInput, match="1 s"):
        eligible(straight(critical=slice(12, 22)))
    assert len(eligible(straight(critical=slice(12, 23)))) == 1


def test_a_policy_whose_network_adds_nothing_to_what_does_not_go_on_is_the_control(networks, near_misses):
    interactions, made = eligible(from_table(near_misses)), networks(gain=0.0)
    for agent in AGENTS:
        made.actor[agent].fading.zero_()
    policy = PolicyPredictor(made.weights({}, {}))
    control = RepeatVelocity(policy.tracked_steps)
    np.testing.assert_allclose(closed_loop(policy, interactions).ade, closed_loop(control, interactions).ade, atol=1e-6)


def test_a_policy_learns_nothing_of_the_future(networks, near_misses):
    interactions = eligible(from_table(near_misses))
    policy = PolicyPredictor(networks().weights({}, {}))
    before = closed_loop(policy, interactions).ade
    rows, late = np.arange(len(interactions)), interactions.first + 1
    for agent in AGENTS:
        for i in rows:
            interactions.observation[agent][i, late[i] :] = 99.0
            interactions.action[agent][i, late[i] :] = 99.0
    assert np.array_equal(closed_loop(policy, interactions).ade, before)


def test_the_hash_of_a_table_changes_with_one_digit_of_a_critical_step(near_misses):
    critical = int(np.flatnonzero(near_misses["curvttc"].to_numpy() < 5.0)[0])
    changed = near_misses.with_columns(ped_x=pl.col("ped_x") + (pl.int_range(pl.len()) == critical) * 1e-9)
    assert table_hash(near_misses) == table_hash(near_misses.clone())
    assert table_hash(changed) != table_hash(near_misses)
