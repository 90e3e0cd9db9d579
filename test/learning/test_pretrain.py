import csv
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from vpsci_ros.data.corpus import NO_CLIPS
from vpsci_ros.errors import InvalidInput, Stopped
from vpsci_ros.learning.divergence import DivergedError
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.learning.training_config import PretrainConfig, ReplayConfig, SpeedRewardsConfig
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import load_weights

SMALL = NetworkConfig(hidden=16, heads=2)
SHORT = PretrainConfig(episodes=6, evaluate_every=3, checkpoint_every=2, replay=ReplayConfig(batch_size=40))


@pytest.fixture(scope="module")
def whole(tmp_path_factory, near_misses):
    """Folder of a run to its end, not to be changed, and what it reported."""
    folder, reports = tmp_path_factory.mktemp("whole"), []
    pretrain(near_misses, SHORT, SMALL, seed=5, out_dir=folder, report=reports.append)
    return folder, reports


def test_a_stopped_run_goes_on_to_the_same_result(tmp_path, near_misses, whole):
    def stop(values):
        if values["episode"] == 3:
            raise Stopped

    with pytest.raises(Stopped):
        pretrain(near_misses, SHORT, SMALL, seed=5, out_dir=tmp_path, report=stop)
    assert not (tmp_path / "pretrained.safetensors").exists()
    resumed = pretrain(near_misses, SHORT, SMALL, seed=5, out_dir=tmp_path)
    expected = load_weights(whole[0] / "pretrained.safetensors")
    assert all(np.array_equal(expected.tensors[name], resumed.tensors[name]) for name in expected.tensors)
    assert (tmp_path / "log.csv").read_text() == (whole[0] / "log.csv").read_text()
    assert not (tmp_path / "checkpoint.safetensors").exists()


def test_a_checkpoint_of_another_run_is_refused(tmp_path, near_misses):
    def stop(values):
        raise Stopped

    with pytest.raises(Stopped):
        pretrain(near_misses, SHORT, SMALL, seed=5, out_dir=tmp_path, report=stop)
    with pytest.raises(InvalidInput, match=r"checkpoint.safetensors: holds a run with seed = 5, and this one has 6"):
        pretrain(near_misses, SHORT, SMALL, seed=6, out_dir=tmp_path)


def test_weights_and_log_say_how_they_came_about(near_misses, whole):
    folder, reports = whole
    weights = load_weights(folder / "pretrained.safetensors")
    assert weights.configuration["PretrainConfig"]["episodes"] == 6
    assert weights.facts["seed"] == 5
    assert weights.facts["stage"] == "pretrained"
    held_out = set(weights.facts["data"]["held_out_clips"])
    clips = {f"{s}/{c}" for s, c in near_misses.select("source", "clip").unique().rows()}
    assert held_out
    assert held_out < clips
    with open(folder / "log.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["episode"]) for row in rows] == [1, 2, 3, 4, 5, 6]
    assert [bool(row["closed_loop_ade"]) for row in rows] == [False, False, True, False, False, True]
    assert weights.facts["held_out"]["errors"]["closed_loop_ade"] == pytest.approx(float(rows[-1]["closed_loop_ade"]))
    assert reports[-1]["control_closed_loop_ade"] > 0.0


def test_a_loss_that_is_not_a_number_stops_the_run_and_leaves_no_weights(tmp_path, near_misses):
    config = replace(SHORT, rewards=SpeedRewardsConfig(1e6), held_out_clips=[NO_CLIPS])
    table = near_misses.with_columns(
        pl.when(pl.col("step") == 3).then(1e22).otherwise(pl.col("ped_vx")).alias("ped_vx")
    )
    with pytest.raises(DivergedError, match=r"update \d+: expected finite values, got .*critic_loss = "):
        pretrain(table, config, SMALL, seed=5, out_dir=tmp_path)
    assert not (tmp_path / "pretrained.safetensors").exists()
