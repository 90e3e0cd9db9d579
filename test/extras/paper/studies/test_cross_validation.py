import numpy as np
import polars as pl
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.errors import InvalidInput, Stopped
from vpsci_ros.evaluation.errors import CONTROLS, evaluate
from vpsci_ros.extras.paper.studies.cross_validation import cross_validate
from vpsci_ros.extras.paper.studies.folds import folds_by_clip
from vpsci_ros.learning.training_config import (
    PretrainConfig,
    ReplayConfig,
)
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import load_weights

SMALL = NetworkConfig(hidden=16, heads=2)
CONFIG = PretrainConfig(episodes=3, replay=ReplayConfig(batch_size=10))


@pytest.fixture(scope="module")
def table():
    return synthetic_near_misses(interactions=16, seed=3).table


def clips(part):
    return set(part.select(pl.concat_str("source", "clip", separator="/")).to_series())


def test_every_clip_is_held_out_once_and_never_learned_from_in_that_fold(table):
    parts = folds_by_clip(table, 3, seed=1)
    held_out = [clips(held) for _, held in parts]
    assert set.union(*held_out) == clips(table)
    assert sum(map(len, held_out)) == len(clips(table))
    for training, held in parts:
        assert not clips(training) & clips(held)
        assert training.height + held.height == table.height
    sizes = [held["interaction"].n_unique() for _, held in parts]
    assert max(sizes) < 2 * min(sizes)
    assert folds_by_clip(table, 3, seed=1)[0][1].equals(parts[0][1])


def test_pooled_errors_are_the_folds_own_and_controls_those_of_the_whole_data(tmp_path, table):
    result = cross_validate(table, CONFIG, SMALL, folds=2, seed=1, out_dir=tmp_path)
    assert set(result["models"]) == {"pretrained", *CONTROLS}
    whole = evaluate(table, {}, seed=1)
    assert result["interactions"] == whole["interactions"] == sum(f["interactions"] for f in result["folds"])
    for name in CONTROLS:
        theirs, mine = (r["models"][name]["closed_loop"]["ade"] for r in (whole, result))
        assert mine == pytest.approx(theirs)
    ade = []
    for number, (_, held) in enumerate(folds_by_clip(table, 2, seed=1), 1):
        weights = load_weights(tmp_path / f"fold_{number}" / "pretrained.safetensors")
        ade.append(evaluate(held, {"own": weights})["models"]["own"]["closed_loop"]["ade"])
    shares = [f["interactions"] / result["interactions"] for f in result["folds"]]
    assert result["models"]["pretrained"]["closed_loop"]["ade"] == pytest.approx(np.dot(shares, ade))


def test_a_stopped_cross_validation_goes_on_with_the_fold_that_is_missing(tmp_path, table):
    def stop(name, values):
        if (name, values["episode"]) == ("2", 2):
            raise Stopped

    seen = []
    with pytest.raises(Stopped):
        cross_validate(table, CONFIG, SMALL, folds=2, seed=1, out_dir=tmp_path, report=stop)
    result = cross_validate(
        table, CONFIG, SMALL, folds=2, seed=1, out_dir=tmp_path, report=lambda n, v: seen.append((n, v["episode"]))
    )
    assert seen == [("2", 3)]
    assert result == cross_validate(table, CONFIG, SMALL, folds=2, seed=1, out_dir=tmp_path / "whole")
    with pytest.raises(InvalidInput, match="a run with seed = 1, and this one has 2"):
        cross_validate(table, CONFIG, SMALL, folds=2, seed=2, out_dir=tmp_path)
