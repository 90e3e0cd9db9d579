"""What a row of an episode says, on drives whose numbers are known by hand."""

import dataclasses
import math

import numpy as np
import polars as pl
import pytest

from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.exam import ExamConfig
from vpsci_ros.exam.measures import episode_table, worst_first
from vpsci_ros.exam.report import make_report, value_of
from vpsci_ros.exam.result import Conduct, RunResult
from vpsci_ros.exam.scores import MEASURES, difference, estimate
from vpsci_ros.world import load_scenarios

PERIOD = 0.05
(SCENARIO,) = load_scenarios([1])
CONFIG = ExamConfig()


def drive(speeds, *, curvttc=np.inf, outcome="goal", episode=0, walking=1.5):
    """A car along x with these speeds, a pedestrian walking along y ten metres ahead."""
    speeds = np.asarray(speeds, float)
    still = np.zeros(len(speeds))
    x = np.concatenate([[0.0], np.cumsum(PERIOD * speeds[:-1])])
    walk = still + 10.0, walking * PERIOD * np.arange(len(speeds)) - 5.0, still, still + walking
    ttc = still + curvttc
    px, py, vx, vy, curvttc, distance = (row[None] for row in (*walk, ttc, still))
    listed = Listed(f"1:{episode}", SCENARIO.name, 1, episode, outcome, float(np.nanmin(ttc)))
    vehicle = x, still, still, speeds, still
    return Episode(
        "",
        listed,
        SCENARIO,
        PERIOD,
        *vehicle,
        px,
        py,
        vx,
        vy,
        curvttc,
        distance,
        curvttc < 5.0,
        curvttc > -1.0,
        kinds=("adult",),
    )


def row(found, alone=(), **options):
    given = {"driver": "ads", "pedestrian": "learned"} | options
    return episode_table(RunResult([found]), list(alone), **given).row(0, named=True)


def test_hard_braking_is_above_the_threshold_and_not_at_it():
    for deceleration, hard in ((3.4, False), (3.6, True)):
        found = row(drive(5.0 - deceleration * PERIOD * np.arange(20)))
        assert found["hardest_braking"] == pytest.approx(deceleration, abs=1e-3)
        assert found["hard_braking"] is hard
    assert row(drive(np.linspace(1.0, 5.0, 50)))["hardest_braking"] == 0.0


@pytest.mark.parametrize(("aside", "left"), [(0.0, False), (-1.6, False), (1.9, True), (-3.0, True)])
def test_a_vehicle_leaves_its_lane_where_its_centre_is_beyond_an_edge_though_it_reaches_its_goal(aside, left):
    """Scenario 1's lane is 3.5 m wide; beyond its ends it counts as straight."""
    lane = SCENARIO.vehicle
    begun = drive(np.full(60, 5.0))
    places = np.array([lane.path.beside(s, aside) for s in np.linspace(0.0, lane.goal, 60)])
    heading = np.array([lane.path.heading(s) for s in np.linspace(0.0, lane.goal, 60)])
    found = row(dataclasses.replace(begun, x=places[:, 0], y=places[:, 1], heading=heading))
    assert lane.lane_width == 3.5
    assert found["outcome"] == "goal"
    assert found["lane_departure"] == pytest.approx(abs(aside), abs=0.03)
    assert found["left_lane"] is left
    unknown = row(dataclasses.replace(begun, scenario=None))
    assert math.isnan(unknown["lane_departure"])
    assert unknown["left_lane"] is False


def test_a_contact_counts_as_moving_only_where_the_vehicle_moves():
    for speed, moving in ((0.0, False), (0.4, False), (3.0, True)):
        found = row(drive(np.full(30, speed), outcome="collision", curvttc=0.5))
        assert found["collision"] is True
        assert found["moving_collision"] is moving
        assert found["impact_speed"] == pytest.approx(speed)
        assert found["least_curvttc"] == 0.0
        assert math.isnan(found["time_lost"])


def test_the_worst_are_contacts_of_a_moving_vehicle_by_speed_and_last_whoever_walked_into_a_standing_one():
    speeds = {0: 0.0, 1: 2.0, 2: 6.0}  # at the contact, by episode
    found = [drive(np.full(30, speed), outcome="collision", episode=number) for number, speed in speeds.items()]
    found += [drive(np.full(30, 4.0), curvttc=ttc, episode=number) for number, ttc in ((3, 0.8), (4, 0.3))]
    table = episode_table(RunResult(found), [], driver="ads", pedestrian="learned")
    assert worst_first(table)["episode"].to_list() == [2, 1, 4, 3, 0]


def test_the_least_curvttc_is_capped_at_its_horizon_and_missing_answers_are_not_looked_at():
    series = np.full(30, np.inf)
    assert row(drive(np.full(30, 4.0), curvttc=series))["least_curvttc"] == 10.0
    series[[3, 4]] = np.nan, 1.5
    found = row(drive(np.full(30, 4.0), curvttc=series))
    assert found["least_curvttc"] == pytest.approx(1.5)
    assert (found["critical"], found["conflict"], found["severe_conflict"]) == (True, True, False)


def along(places, outcome="timeout"):
    """A car that is at these arc lengths of its lane [m], a frame each."""
    lane = SCENARIO.vehicle.path
    xy = np.array([lane.at(s) for s in places])
    speeds = np.append(np.diff(places) / PERIOD, 0.0)
    return dataclasses.replace(drive(speeds, outcome=outcome), x=xy[:, 0], y=xy[:, 1])


def test_time_lost_ends_at_the_goal_and_is_the_delay_to_a_tick():
    goal = SCENARIO.vehicle.goal
    alone = along(np.linspace(goal - 10.0, goal + 30.0, 201))  # at the goal in frame 50, and far beyond it
    assert row(alone, [alone])["time_lost"] == 0.0
    waited = along(np.concatenate([np.full(60, goal - 10.0), np.linspace(goal - 10.0, goal + 1.0, 56)]), "goal")
    assert row(waited, [alone])["time_lost"] == pytest.approx(60 * PERIOD), "it ends a tick after the goal"
    shorter = along(np.linspace(goal - 10.0, goal + 2.0, 61), "goal")
    assert row(shorter, [alone])["time_lost"] == 0.0, "the same motion, whenever the episode ends"
    hurried = along(np.linspace(goal - 10.0, goal + 10.0, 51))
    assert row(hurried, [alone])["time_lost"] == pytest.approx(-25 * PERIOD), "a driver that hurries gains time"


def test_a_car_that_no_longer_arrives_loses_the_time_up_to_the_end():
    goal = SCENARIO.vehicle.goal
    alone, stands = along(np.linspace(goal - 10.0, goal + 30.0, 201)), along(np.full(201, goal - 10.0))
    found = row(stands, [alone])
    assert not found["arrived"]
    assert found["time_lost"] == pytest.approx((200 - 50) * PERIOD)
    assert math.isnan(row(alone)["time_lost"]), "no reference"
    assert math.isnan(row(alone, [stands])["time_lost"]), "alone it does not arrive"


def table(**collisions):
    """Episodes by driver_pedestrian, all critical; a 1 is a collision at speed."""
    parts = []
    for name, outcomes in collisions.items():
        driver, pedestrian = name.split("_", 1)
        drives = [
            drive(np.full(30, 4.0), outcome="collision" if hit else "goal", curvttc=1.0, episode=k)
            for k, hit in enumerate(outcomes)
        ]
        alone = [drive(np.full(30, 4.0), episode=k) for k in range(len(outcomes))]
        parts.append(episode_table(RunResult(drives), alone, driver=driver, pedestrian=pedestrian))
    return pl.concat(parts)


def test_differences_pair_the_episodes_that_both_have():
    rows = table(ads_learned=[0, 0, 0, 1], ads_walker=[1, 1, 0, 1, 1, 1])
    learned, walker = (rows.filter(pl.col("pedestrian") == name) for name in ("learned", "walker"))
    found, p = difference(walker, learned, MEASURES["collision_rate"])
    assert (found.value, found.n, p) == (0.5, 4, 0.5)
    lost, _ = difference(walker, learned, MEASURES["time_lost"])
    assert lost.n == 1, "only where neither ended in a contact"


def test_evasion_success_counts_critical_episodes_only():
    rows = table(ads_learned=[0, 1, 0, 0])
    assert estimate(rows, MEASURES["evasion_success_rate"]).value == 0.75
    calm = rows.with_columns(pl.col("episode").ne(0).alias("critical"))
    assert estimate(calm, MEASURES["evasion_success_rate"]).n == 3


def test_a_report_says_how_much_the_driver_lives_off_the_pedestrians_yielding():
    rows = table(ads_learned=[0, 0, 0, 0], ads_walker=[1, 1, 0, 0])
    gave_way = pl.Series(["pedestrian", "pedestrian", "pedestrian", "vehicle", *["nobody"] * 4])
    report = make_report(rows.with_columns(gave_way.alias("yielded")), {}, CONFIG)
    reliance = report["reliance"]["ads"]
    assert reliance["left_to_pedestrian"]["value"] == 0.75
    assert (reliance["of_those_collide"]["value"], reliance["of_those_collide"]["n"]) == (pytest.approx(2 / 3), 3)
    assert reliance["moving_collision_increase"]["value"] == 0.5
    assert value_of(report, "moving_collision_increase", "walker") == 0.5


def test_who_stops_short_of_the_goal_for_good_has_not_arrived_and_stood_still():
    lane = SCENARIO.vehicle

    def ends(at, speed, outcome):
        x, y = lane.path.at(at)
        begun = drive([4.0, speed], outcome=outcome)
        return row(dataclasses.replace(begun, x=np.array([x - 1.0, x]), y=np.array([y, y])))

    found = [ends(lane.goal + 0.5, 0.0, "timeout"), ends(lane.goal - 5.0, 0.0, "timeout"),
             ends(lane.goal - 5.0, 2.0, "timeout"), ends(lane.goal - 5.0, 0.0, "collision")]  # fmt: skip
    assert [each["arrived"] for each in found] == [True, False, False, False]
    assert [each["stood_still"] for each in found] == [False, True, False, False]
    rows = pl.DataFrame(found)
    rates = {name: estimate(rows, MEASURES[f"{name}_rate"]) for name in ("arrived", "never_arrived", "stood_still")}
    assert {name: (rate.value, rate.n) for name, rate in rates.items()} == {
        "arrived": (0.25, 4), "never_arrived": (pytest.approx(2.0 / 3.0), 3), "stood_still": (0.25, 4)
    }  # fmt: skip


def test_a_report_counts_refused_commands_and_unanswered_ticks():
    run = RunResult([drive(np.full(30, 4.0))], unanswered={(1, 0): 7})
    rows = episode_table(run, [], driver="ads", pedestrian="learned")
    report = make_report(rows, {"learned": Conduct(4, 12, failure="the ADS was killed")}, CONFIG)
    conduct = report["conduct"]["learned"]
    assert (conduct["episodes_driven"], conduct["episodes_wanted"], conduct["commands_refused"]) == (1, 4, 12)
    assert (conduct["ticks_unanswered"], conduct["episodes_with_unanswered_ticks"]) == (7, 1)
    assert value_of(report, "ticks_unanswered", "learned") == 7


def test_an_exam_without_a_pedestrian_or_an_ads_is_refused():
    for values, said in (({"pedestrians": []}, "name at least one"), ({"ads": " "}, "ads is empty"),
                         ({"pedestrians": ["recorded"]}, "no recordings are given")):  # fmt: skip
        with pytest.raises(InvalidInput, match=said):
            ExamConfig(**values)
