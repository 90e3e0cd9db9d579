"""The search in one process: the stand-in drives as who it has learned from, and failures are found where they are."""

import numpy as np
import pytest

from vpsci_ros.cli.options import read_sections
from vpsci_ros.data.episode import Episode, Listed
from vpsci_ros.data.episode_block import ended_episodes
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.exam import prepare
from vpsci_ros.exam.run import loop_with
from vpsci_ros.extras.exam_extra.search.imitation import HOLDING, Imitation, Recent, lessons
from vpsci_ros.extras.exam_extra.search.margin import least_margin
from vpsci_ros.extras.exam_extra.search.seek import Driven, SearchConfig, rehearse, seek
from vpsci_ros.resources import params_path
from vpsci_ros.world import RUNNING
from vpsci_ros.world.state import EPISODE
from vpsci_ros.world.tick import Actions


def exam_with(*settings):
    given = ("world_simulator.scenarios=[1,8]", "world_simulator.seed=3",
             "world_simulator.episode_time=8.0", "world_simulator.spawn=human")  # fmt: skip
    return prepare(read_sections(params_path("ads_test"), [*given, *settings]))


def careless(state):
    """Drive at 5 m/s, and brake for whoever is less than 7 m straight ahead: too late now and then."""
    cos, sin = np.cos(state["vehicle_heading"]), np.sin(state["vehicle_heading"])
    x, y = state["pedestrian_x"] - state["vehicle_x"], state["pedestrian_y"] - state["vehicle_y"]
    forward, left = cos * x + sin * y, cos * y - sin * x
    near = (forward > 0.0) & (forward < 7.0) & (abs(left) < 1.5)
    wanted = np.where(near, -6.0, np.clip(2.0 * (5.0 - state["vehicle_speed"]), -2.0, 2.0))
    return np.stack([wanted, np.zeros(len(state))], axis=1)


def margins(exam, keys, ticks=None):
    """Return the least margins of episodes that `careless` drives; their ticks go to the list `ticks`."""
    loop = loop_with(exam, "walker", "external", keys, len(keys))
    steps = list(loop.ticks(lambda tick, _: Actions(vehicle=careless(tick.state))))
    if ticks is not None:
        ticks += steps
    episodes = ended_episodes(steps, exam.world.tick, exam.scenarios)
    least = {episode.key: least_margin(exam.config.failure, episode) for episode in episodes}
    return np.array([least[key] for key in keys])


def drive_with(exam, keys):
    """Return least margins, and lessons, of episodes that `careless` drives."""
    ticks = []
    margin = margins(exam, keys, ticks)
    return margin, *lessons(ended_episodes(ticks, 0.05, exam.scenarios), 1)


def test_failures_are_found_where_they_are_and_counted_right():
    exam = exam_with()
    pool = [(scenario, number) for number in range(150) for scenario in (1, 8)]
    truth = margins(exam, pool) < 0.0

    def drive(_, keys):
        margin, seen, done = drive_with(exam, keys)
        return Driven(keys, margin < 0.0, seen, done)

    reported = []
    plan = seek(exam, SearchConfig("walker", 300, 60), pool, drive, lambda what, done, total: reported.append(what))
    np.testing.assert_array_equal(plan.failed[plan.driven], truth[plan.driven])
    assert 5 <= truth.sum() <= 60
    assert plan.failed.sum() > 1.5 * 60 * truth.mean()
    count = plan.count()
    assert count.failures_low <= truth.sum() <= count.failures_high
    assert set(reported) == {"learning how it drives", "rehearsing"}


def test_the_stand_in_comes_as_near_as_who_it_has_learned_from():
    exam = exam_with()
    keys = [(scenario, number) for number in range(20) for scenario in (1, 8)]
    _, seen, done = drive_with(exam, keys)
    stand_in, others = Imitation(seen, done, seed=0), [(1, n) for n in range(100, 140)]
    played = rehearse(exam, "walker", others, stand_in, lambda *_: None)
    own = margins(exam, others)
    assert np.corrcoef(np.clip(played, -1.0, 5.0), np.clip(own, -1.0, 5.0))[0, 1] > 0.9
    assert np.median(abs(played - own)) < 0.2 * np.median(abs(own - np.median(own)))


def test_a_vehicle_that_stays_where_it_stands_is_taken_to_brake_so_that_its_stand_in_does_not_creep():
    speed, one = np.array([1.0, 0.0, 0.0, 0.5]), np.ones((1, 4))
    listed = Listed("1:0", "A", 1, 0, "timeout", 9.0)
    still = Episode("test", listed, None, 0.05, *[speed] * 5, *[one] * 6, one > 0.0, one > 0.0)
    _, done = lessons([still], 1)
    np.testing.assert_allclose(done, [-20.0, HOLDING, 10.0])


def test_what_was_seen_before_an_episode_began_is_forgotten():
    recent, state, far = Recent(), np.zeros(1, EPISODE), np.array([np.inf])
    state["status"], state["pedestrian_x"] = RUNNING, 30.0
    before, _ = recent.features(state, far)
    state["episode"], state["pedestrian_x"] = 1, 10.0
    after, _ = recent.features(state, far)
    fresh, _ = Recent().features(state, far)
    np.testing.assert_array_equal(after, fresh)
    assert (before != after).any()


def test_of_several_pedestrians_the_nearest_counts():
    state = np.zeros(2, EPISODE)
    state["status"], state["pedestrian_x"] = RUNNING, [30.0, 10.0]
    two, rows = Recent(2).features(state, np.array([np.inf, 3.0]))
    one, _ = Recent().features(state[1:], np.array([3.0]))
    assert rows.tolist() == [1]
    np.testing.assert_array_equal(two, one)


def test_a_search_for_what_cannot_be_searched_is_refused():
    with pytest.raises(InvalidInput, match="unknown 'recorded'"):
        SearchConfig("recorded", 100, 40)
    with pytest.raises(InvalidInput, match="--budget 300 exceeds --pool 200"):
        SearchConfig("walker", 200, 300)
