"""The four conditions of section 3.3, each at its bound."""

import numpy as np
import pytest
from synthetic import block_of_pairs

from vpsci_ros.data.dataset_description import counts_of
from vpsci_ros.data.episode import QUANTITIES
from vpsci_ros.data.episode_block import KEPT, REASONS, EpisodeBlock
from vpsci_ros.data.filters import FilterConfig, apply_filters
from vpsci_ros.world.state import COLLISION


def batch(frames: int = 100, least: float = 4.9, vehicle: float = 20.0, pedestrian: float = 8.0) -> EpisodeBlock:
    """Return one episode that moves straight so far [m] from the first to the last frame."""
    values = np.zeros((1, frames, len(QUANTITIES)), np.float32)
    part = np.arange(frames) / (frames - 1)
    values[0, :, QUANTITIES.index("position_x_av")] = 0.6 * vehicle * part
    values[0, :, QUANTITIES.index("position_y_av")] = 0.8 * vehicle * part
    values[0, :, QUANTITIES.index("position_y_ped")] = pedestrian * part
    values[0, :, QUANTITIES.index("CurvTTC")] = np.inf
    values[0, frames // 2, QUANTITIES.index("CurvTTC")] = least
    return block_of_pairs(values)


def reason(episode: EpisodeBlock) -> str:
    return REASONS[apply_filters(episode, FilterConfig()).records["reason"][0]]


def test_an_episode_that_meets_every_condition_is_kept() -> None:
    verdict = apply_filters(batch(), FilterConfig()).records
    assert verdict["reason"][0] == KEPT
    assert verdict["least_curvttc"][0] == pytest.approx(4.9)
    assert verdict["vehicle_path"][0] == pytest.approx(20.0, rel=1e-5)
    assert verdict["pedestrian_path"][0] == pytest.approx(8.0, rel=1e-5)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"least": 5.0}, "not critical"),
        ({"least": 4.999}, "kept"),
        ({"frames": 99}, "too short"),
        ({"frames": 100}, "kept"),
        ({"vehicle": 10.0}, "vehicle hardly moved"),
        ({"vehicle": 10.01}, "kept"),
        ({"pedestrian": 4.0}, "pedestrian hardly moved"),
        ({"pedestrian": 4.01}, "kept"),
    ],
)
def test_each_condition_has_the_bound_of_the_paper(change: dict, expected: str) -> None:
    assert reason(batch(**change)) == expected


@pytest.mark.parametrize(("missing", "expected"), [(9, "kept"), (10, "velocities missing")])
@pytest.mark.parametrize("name", ["velocity_x_av", "velocity_y_ped"])
def test_fewer_than_ten_missing_velocities_in_a_row_are_allowed(name: str, missing: int, expected: str) -> None:
    episode = batch()
    episode.values[20 : 20 + missing, QUANTITIES.index(name)] = np.nan
    episode.values[60:69, QUANTITIES.index(name)] = np.nan
    assert reason(episode) == expected


def test_the_distance_is_that_of_the_ends_and_the_path_that_of_the_way() -> None:
    episode = batch(frames=101)
    x = QUANTITIES.index("position_x_ped")
    episode.values[:, x] = 3.0 * np.sin(np.pi * np.arange(101) / 100)
    verdict = apply_filters(episode, FilterConfig(pedestrian_distance=8.01)).records
    assert REASONS[verdict["reason"][0]] == "pedestrian hardly moved"
    assert verdict["pedestrian_path"][0] > 9.0


def test_every_condition_is_checked_and_the_first_names_the_reason() -> None:
    verdict = apply_filters(batch(frames=50, least=7.0, vehicle=1.0), FilterConfig()).records
    assert verdict["failed"][0].tolist() == [True, False, True, True, False]
    assert REASONS[verdict["reason"][0]] == "not critical"


def test_early_collisions_are_those_that_only_their_length_drops() -> None:
    long, early, early_goal, far = batch(), batch(frames=60, least=1.0), batch(frames=60), batch(60, vehicle=1.0)
    for episode in (long, early, far):
        episode.records["outcome"] = COLLISION
    verdicts = [apply_filters(episode, FilterConfig()).records for episode in (long, early, early_goal, far)]
    counts = counts_of(np.concatenate(verdicts))
    assert counts["kept_outcomes"]["collision"] == counts["kept"] == 1
    assert counts["rejected_collisions"]["too short"] == 2
    assert counts["with_early_collisions"]["kept"] == counts["with_early_collisions"]["collisions"] == 2
    assert counts["with_early_collisions"]["least_curvttc"] == [0.0] * 3, "they touched, though between frames"
