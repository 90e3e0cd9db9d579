"""A list of episodes: read as it was written, and refused where its episodes would begin otherwise."""

import json

import pytest

from vpsci_ros.cli.options import read_sections
from vpsci_ros.errors import InvalidInput
from vpsci_ros.exam.episode_list import with_episode_list, write_episode_list
from vpsci_ros.exam.prepare import prepare
from vpsci_ros.resources import params_path

ROWS = [{"scenario": 8, "episode": 3, "impact_speed": 2.5}, {"scenario": 1, "episode": 17, "impact_speed": None}]


def sections(*settings):
    return read_sections(params_path("ads_test"), list(settings))


@pytest.fixture
def written(tmp_path):
    exam = prepare(sections("world_simulator.seed=5"))
    write_episode_list(tmp_path / "failures.json", ROWS, exam.run, exam.world, exam.scenarios)
    return tmp_path / "failures.json"


def test_its_episodes_and_its_seed_take_the_place_of_the_parameters_own(written):
    exam = prepare(with_episode_list(sections("world_simulator.episodes=99"), written))
    assert exam.episodes == [(8, 3), (1, 17)]
    assert exam.run.seed == 5
    assert exam.run.total == 2
    assert [scenario.number for scenario in exam.scenarios] == [1, 8]


def test_parameters_under_which_they_begin_otherwise_are_refused_by_name(written):
    with pytest.raises(InvalidInput, match="is of episodes with world.episode_time = 30.0, and this one has 12.0"):
        with_episode_list(sections("world_simulator.episode_time=12.0"), written)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"form": "another"}, "expected a list of episodes"),
        ({"episodes": []}, "it holds no episode"),
        ({"episodes": [7]}, "an entry without scenario and episode"),
        ({"episodes": [{"scenario": 1, "episode": "17"}]}, "must be whole numbers"),
        ({"episodes": [{"scenario": 1, "episode": -1}]}, "only"),
        ({"seed": None}, "seed"),
        ({"scenarios": {"1": "0", "8": "0"}}, "is of episodes with scenarios"),
    ],
)
def test_anything_else_is_refused_with_its_name(written, change, said):
    written.write_text(json.dumps(json.loads(written.read_text()) | change))
    with pytest.raises(InvalidInput, match=said):
        with_episode_list(sections(), written)


def test_another_kind_of_file_is_refused(tmp_path):
    (tmp_path / "list").write_text("[1, 2]")
    with pytest.raises(InvalidInput, match="expected a list of episodes"):
        with_episode_list(sections(), tmp_path / "list")
