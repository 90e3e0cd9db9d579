"""The forecast of a bank: each clip has a training that has not seen it, and a stopped command resumes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.errors import InvalidInput, Stopped
from vpsci_ros.learning import forecast
from vpsci_ros.learning.forecast import PARTS, learn_forecast, roll_outs
from vpsci_ros.learning.training_config import PretrainConfig
from vpsci_ros.policy.forecast import forecasts
from vpsci_ros.policy.policy_config import NetworkConfig
from vpsci_ros.policy.weights import load_weights

NETWORK, CONFIG = NetworkConfig(hidden=16, heads=2), replace(PretrainConfig(), episodes=2)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forecast, "UPDATES", 400)
    monkeypatch.setattr(forecast, "MOST", 400)


@pytest.mark.usefixtures("quick")
def test_a_stopped_forecast_resumes_and_each_clip_is_unseen_by_one_training(tmp_path: Path) -> None:
    table, trained = synthetic_near_misses(interactions=12, seed=3).table, []

    def report(name: str, values: dict[str, float]) -> None:
        trained.append(name)
        if stops and name == "part2":
            raise Stopped

    stops = True
    with pytest.raises(Stopped):
        learn_forecast(table, CONFIG, NETWORK, seed=1, folder=tmp_path / "a", report=report)
    stops, trained = False, []
    resumed = learn_forecast(table, CONFIG, NETWORK, seed=1, folder=tmp_path / "a", report=report)
    assert set(trained) == {"part2", "part3", "part4"}
    whole = learn_forecast(table, CONFIG, NETWORK, seed=1, folder=tmp_path / "b", report=report)
    for one, other in zip(resumed.networks, whole.networks, strict=True):
        np.testing.assert_array_equal(one, other)
    clips = {f"{source}/{clip}" for source, clip in table.select("source", "clip").rows()}
    assert resumed.unseen_by.keys() == clips
    assert set(resumed.unseen_by.values()) == set(range(1, 1 + PARTS))
    with pytest.raises(InvalidInput, match="seed = 1, and this one has 2"):
        learn_forecast(table, CONFIG, NETWORK, seed=2, folder=tmp_path / "a", report=report)


@pytest.mark.usefixtures("quick")
def test_the_small_network_predicts_the_roll_outs_better_than_their_mean(tmp_path: Path) -> None:
    table = synthetic_near_misses(interactions=12, seed=3).table
    made = learn_forecast(table, CONFIG, NETWORK, seed=1, folder=tmp_path, report=lambda *_: None)
    situations = forecast._situations(table, 9)[:400]
    wanted = roll_outs(load_weights(tmp_path / "part1" / "pretrained.safetensors"), situations)
    found = forecasts(made.networks, np.ones(len(situations), np.int64), situations)
    error, spread = ((wanted - found) ** 2).mean(), wanted.var(axis=0).mean()
    assert error < 0.5 * spread
