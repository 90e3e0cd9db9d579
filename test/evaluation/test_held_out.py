"""No stage learns from the clips that its held-out error is measured on."""

import numpy as np
import polars as pl
import pytest

from vpsci_ros.data import corpus
from vpsci_ros.data.interactions import from_table
from vpsci_ros.learning.pretrain import pretrain
from vpsci_ros.learning.refine import Refiner
from vpsci_ros.learning.replay import recorded_histories
from vpsci_ros.learning.training_config import PretrainConfig, RefineConfig, ReplayConfig
from vpsci_ros.policy.policy_config import NetworkConfig

SMALL = NetworkConfig(hidden=16, heads=2)
SHORT = PretrainConfig(
    episodes=6,
    replay=ReplayConfig(batch_size=60),
)
CLIP = pl.concat_str("source", "clip", separator="/")


def all_clips(table):
    return set(table.select(CLIP).to_series())


def what_happened(histories):
    return {history.observation["vehicle"].tobytes() for history in histories}


def test_what_stage_1_learns_does_not_depend_on_what_happened_in_the_held_out_clips(tmp_path, near_misses):
    def learned(table, name):
        return pretrain(table, SHORT, SMALL, seed=5, out_dir=tmp_path / name)

    first = learned(near_misses, "first")
    held_out = CLIP.is_in(first.facts["data"]["held_out_clips"])
    hurried = [pl.when(held_out).then(1.5 * pl.col(c)).otherwise(pl.col(c)).alias(c) for c in ("veh_vx", "ped_vx")]
    second = learned(near_misses.with_columns(hurried), "second")
    assert first.facts["held_out"]["errors"] != second.facts["held_out"]["errors"]
    assert first.facts["data"]["held_out_clips"] == second.facts["data"]["held_out_clips"]
    assert all(np.array_equal(first.tensors[name], second.tensors[name]) for name in first.tensors)


@pytest.mark.parametrize("named", [True, False])
def test_stage_2_learns_from_no_clip_that_is_held_out(networks, near_misses, named, monkeypatch):
    """Whether its weights name clips of the table that stage 1 held out, or stage 2 holds out clips of its own."""
    monkeypatch.setattr("vpsci_ros.learning.refine.REAL_STEPS", 10_000)
    fraction, seed = (0.4, 11) if named else (corpus.SHARE, corpus.SPLIT)
    clips = all_clips(corpus.split_by_clip(near_misses, fraction, seed)[1])
    weights = networks().weights({}, {"data": {"held_out_clips": sorted(clips)}} if named else {})
    refiner = Refiner(RefineConfig(), weights, near_misses, seed=4)
    held_out, real = refiner._held_out.interactions, what_happened(refiner._buffer.histories)
    learned_from = from_table(near_misses.filter(~CLIP.is_in(sorted(clips))))
    assert len(held_out) > 0
    assert set(held_out.clip) <= clips
    assert real == what_happened(recorded_histories(learned_from))
    assert not real & what_happened(recorded_histories(held_out))
