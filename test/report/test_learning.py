from pathlib import Path

import numpy as np
import polars as pl
from matplotlib.image import imread

from vpsci_ros.report.learning import save_learning


def write(path: Path, rows: list[dict[str, float]]) -> None:
    pl.DataFrame(rows, infer_schema_length=None).write_csv(path)


def colours(path: Path) -> set[tuple[int, ...]]:
    return {tuple(pixel) for pixel in np.rint(255 * imread(path)[..., :3].reshape(-1, 3)).astype(int)}


VEHICLE, PEDESTRIAN = (8, 81, 156), (203, 24, 29)


def test_figure_6_draws_both_agents_from_the_first_row_of_the_log_on(tmp_path):
    write(tmp_path / "refine_log.csv", [{"updates": 1, "episodes": 1, "vehicle_critic_loss": 2.0}])
    write(tmp_path / "refine_episodes.csv", [{"episode": 1, "vehicle": 0.0, "pedestrian": 5.0}])
    assert save_learning(tmp_path) == tmp_path / "learning.png"
    assert {VEHICLE, PEDESTRIAN} <= colours(tmp_path / "learning.png")


def test_stage_1_is_drawn_while_held_out_errors_are_still_missing(tmp_path):
    rows = [{"episode": e, "vehicle_reward": -1.0, "pedestrian_reward": -2.0} for e in range(1, 4)]
    write(tmp_path / "log.csv", rows)
    assert save_learning(tmp_path) is not None
    assert {VEHICLE, PEDESTRIAN} <= colours(tmp_path / "learning.png")


def test_without_a_log_nothing_is_drawn(tmp_path):
    assert save_learning(tmp_path) is None
    assert not any(tmp_path.iterdir())


def test_stage_2_without_a_critical_episode_is_drawn(tmp_path):
    """`write_log` leaves an empty line where there are no rows."""
    (tmp_path / "refine_log.csv").write_text("updates,episodes,collision_rate,goal_rate\n0,0,,\n")
    (tmp_path / "refine_episodes.csv").write_text("\r\n")
    picture = save_learning(tmp_path)
    assert imread(picture).std() > 0
