import polars as pl
import pytest

from vpsci_ros.errors import InvalidInput
from vpsci_ros.learning.config import NetworkConfig, PretrainConfig, RefineConfig
from vpsci_ros.learning.studies import WEIGHTINGS, reward_weight_study, sample_size_study
from vpsci_ros.world import load_scenarios

SMALL = NetworkConfig(hidden=16, heads=2, key_dimension=8, actor_hidden=[8, 8], critic_hidden=[8, 8])


def test_sample_sizes_make_the_rows_of_table_3(tmp_path, near_misses):
    config = PretrainConfig(episodes=2, rollouts=2, rollout_steps=2, batch_size=10, held_out_fraction=0.0)
    table = sample_size_study(near_misses, config, SMALL, sizes=(4, 8), seed=1, out_dir=tmp_path)
    assert table["interactions"].to_list() == [4, 8]
    assert (table["vehicle_reward"] < 0.0).all()
    assert (tmp_path / "table_3.csv").exists()
    with pytest.raises(InvalidInput, match="1000 interactions wanted"):
        sample_size_study(near_misses, config, SMALL, sizes=(1000,), seed=1, out_dir=tmp_path)


def test_reward_weightings_make_the_rows_of_table_5(tmp_path, networks, near_misses):
    config = RefineConfig(
        warm_up_steps=20, steps_per_update=40, batch_size=40, critic_warm_up=1, updates_per_refresh=50
    )
    table = reward_weight_study(
        near_misses,
        config,
        networks(gain=1.0).weights({}, {}),
        scenarios=load_scenarios([1]),
        episodes=[(1, e) for e in range(4)],
        batch=4,
        seed=4,
        out_dir=tmp_path,
        weightings={name: WEIGHTINGS[name] for name in ("safety", "adaptive")},
    )
    assert table["weights"].to_list() == ["safety", "adaptive"]
    assert table["w_collision"][0] == pytest.approx(0.6)
    assert {"collision_rate", "goal_rate", "held_out_reconstruction_ade", "held_out_reconstruction_fde"} <= set(
        table.columns
    )
    assert pl.read_csv(tmp_path / "table_5.csv").height == 2
