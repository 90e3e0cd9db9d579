import io

import numpy as np
import polars as pl
import pytest
from matplotlib.image import imread
from rich.console import Console

from vpsci_ros.extras.paper.published import TABLE_3, TABLE_5
from vpsci_ros.extras.paper.studies.tables import print_table_3, print_table_5, save_table_3, save_table_5

ERRORS = {"reconstruction_ade": 0.01, "reconstruction_fde": 0.02, "closed_loop_ade": 0.3, "closed_loop_fde": 0.6}
VEHICLE, PEDESTRIAN = (8, 81, 156), (203, 24, 29)


def colours(path):
    return {tuple(pixel) for pixel in np.rint(255 * imread(path)[..., :3].reshape(-1, 3)).astype(int)}


@pytest.fixture
def console():
    return Console(width=80, file=io.StringIO())


def test_table_3_stands_beside_the_papers_in_80_columns(tmp_path, console):
    learned = {"vehicle_reward": -13.5, "pedestrian_reward": -14.4}
    learned |= {"vehicle_critic_loss": 38.2, "pedestrian_critic_loss": 1.434}
    held_out = ERRORS | {"vehicle_held_out_reward": -7.8, "pedestrian_held_out_reward": -12.1}
    rows = [{"interactions": f"{n}"} | learned | (held_out if n < 300 else {}) for n in TABLE_3]
    table = pl.DataFrame([*rows, {"interactions": "repeat_velocity"} | held_out], infer_schema_length=None)
    print_table_3(table, console)
    text = console.file.getvalue()
    assert "…" not in text
    for published in TABLE_3.values():
        assert f"[{published.vehicle_reward}]" in text
    save_table_3(table, tmp_path / "table_3.png")
    assert {VEHICLE, PEDESTRIAN} <= colours(tmp_path / "table_3.png")


def test_table_5_stands_beside_the_papers_in_80_columns(tmp_path, console):
    names = ("collision_low", "collision_rate", "collision_high", "goal_low", "goal_rate", "goal_high")
    rates = dict(zip(names, (0.479, 0.511, 0.554, 0.790, 0.812, 0.833), strict=True))
    rates |= {"critical_episodes": 1234, "least_curvttc_50": 0.06}
    learned = {"w_collision": 0.33, "w_goal": 0.34, "w_speed": 0.33}
    rows = [{"weights": name} | rates | ERRORS | learned for name in TABLE_5]
    controls = [{"weights": name} | rates | ERRORS for name in ("pretrained", "constant_velocity")]
    table = pl.DataFrame([*rows, *controls], infer_schema_length=None)
    print_table_5(table, console)
    text = console.file.getvalue()
    assert "…" not in text
    assert "adaptive           51.1 (48-55)   [8.3]" in text
    assert "33 34 33" in text
    save_table_5(table, tmp_path / "table_5.png")
    assert (tmp_path / "table_5.png").stat().st_size > 10_000
