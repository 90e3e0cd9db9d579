"""All protocols in one run, resumed from its parts; evidence from elsewhere is read as published."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from synthetic import block_of_pairs, synthetic_near_misses

from vpsci_ros.data.dataset import DatasetWriter
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.documents import read_json
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.realism.elsewhere import elsewhere, reactions
from vpsci_ros.evaluation.realism.free import AFTER, as_near_misses, described, free
from vpsci_ros.evaluation.realism.onsets import Onsets, borrowable, find_onsets
from vpsci_ros.evaluation.realism.run import RealismConfig, measure_realism
from vpsci_ros.evaluation.realism.same_start import CONTROLS, SameStart
from vpsci_ros.evaluation.realism.samplers import constant_turn, constant_velocity
from vpsci_ros.evaluation.realism.two_sample import two_sample
from vpsci_ros.runs.files import write_json

CONFLICTS = """"Encroachment_Time","Reaction.to.conflict","Ped.Reaction","Encroachment.Car.After.Ped"
2,"Driver slowed down","No obvious reaction",TRUE
-3,"No obvious reaction","Ran to avoid collision",FALSE
5,"Driver sped up","No obvious reaction",TRUE
9,"Driver fully stopped","Changed direction",TRUE
"""


@pytest.fixture
def conflicts(tmp_path: Path) -> Path:
    path = tmp_path / "datlong.csv"
    path.write_text(CONFLICTS)
    return path


def noisy(onsets: Onsets) -> np.ndarray:
    """Roll-outs: the recording with one shift each."""
    shift = np.random.default_rng(0).normal(size=(len(onsets), 4, 2, 1, 2))
    return onsets.recorded[:, None] + shift


@pytest.fixture
def one_repetition(monkeypatch: pytest.MonkeyPatch) -> RealismConfig:
    """The least that a classifier does: nothing here asserts how well it tells anything apart."""
    monkeypatch.setattr("vpsci_ros.evaluation.realism.same_start.FAMILY_REPETITIONS", 1)
    monkeypatch.setattr("vpsci_ros.evaluation.realism.two_sample.FOLDS", 2)
    return RealismConfig(repetitions=1)


def test_a_run_measures_controls_and_models_of_each_source_too_and_goes_on_from_its_parts(
    conflicts: Path, tmp_path: Path, one_repetition: RealismConfig
) -> None:
    place = pl.when(pl.col("interaction") < 8).then(pl.lit("here")).otherwise(pl.lit("there"))
    table = synthetic_near_misses(interactions=16, seed=3).table.with_columns(source=place)
    reported: list[str] = []

    def measure() -> dict[str, Any]:
        options = {"conflicts": conflicts, "parts": tmp_path, "inputs": {"weights": "1f"}}
        options |= {"notify": lambda name, *_: reported.append(name)}
        return measure_realism(table, {"noisy": noisy}, one_repetition, **options)["same_start"]

    found = measure()
    models = found["models"]
    assert list(models) == [*CONTROLS, "noisy"]
    assert reported == list(models)
    assert models["recorded"]["energy_score"] == pytest.approx(0.0, abs=1e-12)
    assert models["constant_velocity_tracked"]["of_constant_velocity"] == pytest.approx(1.0)
    assert models["recorded"]["likelihood"] > models["constant_velocity_tracked"]["likelihood"]
    assert models["noisy"]["roll_outs"] == 4
    assert found["interactions"] == sum(found["by_source"][name]["interactions"] for name in ("here", "there"))
    assert list(found["by_source"]["there"]["models"]) == list(models)
    assert found["not_in_library"] == []
    path = tmp_path / "same_start_noisy.part.json"
    write_json(path, read_json(path) | {"found": {"kept": True}})
    assert measure()["models"]["noisy"] == {"kept": True}
    write_json(path, {"inputs_sha256": {"weights": "2e"}, "found": {"kept": True}})
    assert measure()["models"]["noisy"] == models["noisy"], "what was measured of other weights was kept"
    path.write_text(path.read_text()[:100])
    assert measure()["models"]["noisy"] == models["noisy"], "what is damaged was kept"


def test_each_source_has_donors_of_its_own() -> None:
    place = pl.when(pl.col("interaction") < 8).then(pl.lit("here")).otherwise(pl.lit("there"))
    onsets = find_onsets(synthetic_near_misses(interactions=16, seed=3).table.with_columns(source=place))
    allowed = borrowable(onsets, onsets)
    assert (onsets.source[:, None] == onsets.source[None])[allowed].all()
    assert not np.diag(allowed).any()
    foreign = SameStart(onsets.take(np.flatnonzero(onsets.source == "here")), onsets.take(np.array([15])), 0)
    assert foreign.missing == ["here"]  # the only one in the library is from there


def test_the_mean_turn_repeats_a_motion_that_everybody_has() -> None:
    t = 0.1 * np.arange(31)
    speed, way = 4.0 - 0.5 * t, 4.0 * t - 0.25 * t**2
    angle = -0.1 * way  # a bend of 10 m, 0.5 m/s2
    x, y = 10.0 * np.sin(-angle), -10.0 * (1.0 - np.cos(angle))
    motion = np.stack([x, y, angle, speed * np.cos(angle), speed * np.sin(angle), x * 0, x * 0, x * 0, x * 0], axis=1)
    base = find_onsets(synthetic_near_misses(interactions=4, seed=3).table).take(np.array([0, 1]))
    own = replace(base.interactions, motion=np.stack([motion, motion]), first=np.zeros(2, np.int64))
    onsets = replace(base, interactions=own)
    assert constant_turn(onsets, onsets, constant_velocity(onsets))[:, 0, 0] == pytest.approx(
        onsets.recorded[:, 0], abs=0.05
    )


def test_a_model_must_not_have_a_controls_name() -> None:
    table = synthetic_near_misses(interactions=4, seed=3).table
    with pytest.raises(InvalidInput, match="recorded is the name of a control"):
        measure_realism(table, {"recorded": noisy}, RealismConfig(repetitions=1))


def test_reactions_elsewhere_are_counted_by_encroachment_time(conflicts: Path) -> None:
    table = synthetic_near_misses(interactions=24, seed=3).table
    shares = elsewhere(conflicts, table, None, 0)
    near = shares["within_3_s"]["video"]
    assert near["conflicts"] == 2  # 3 s before counts as 3 s after
    assert near["driver"] == {"none": 0.5, "slows": 0.5, "stops": 0.0, "speeds up": 0.0, "swerves": 0.0}
    assert near["pedestrian"]["hurries or runs"] == 0.5
    assert shares["within_5_s"]["video"]["pedestrian_first"] == pytest.approx(2 / 3)
    assert 0 < shares["within_5_s"]["near_misses"]["conflicts"] <= 24


def test_an_unknown_reaction_is_refused(conflicts: Path) -> None:
    conflicts.write_text(CONFLICTS.replace("Driver sped up", "Driver waved"))
    with pytest.raises(InvalidInput, match="expected one of No obvious reaction, .*got 'Driver waved'"):
        elsewhere(conflicts, synthetic_near_misses(interactions=4, seed=3).table, None, 0)


def test_who_stops_stops_and_who_walks_on_does_not_react(dataset: Path) -> None:
    found = reactions(as_near_misses(Dataset(dataset), 100, 0))
    assert set(found["driver"].to_list()) <= {"none", "slows", "stops", "speeds up"}
    car_stops = found.filter(pl.col("driver") == "stops")
    assert car_stops.height
    assert (car_stops["pedestrian"] == "none").all()
    assert car_stops["pedestrian_first"].all()


def test_generated_episodes_are_described_by_the_same_lines_as_recordings(dataset: Path) -> None:
    made = described(as_near_misses(Dataset(dataset), 100, 0))
    recorded = described(synthetic_near_misses(interactions=6, seed=3).table)
    assert made.keys() == recorded.keys()
    assert made["vehicle_over_3"] == 1.0
    assert made["onset_curvttc_median"] < 5.0


def test_what_comes_5_s_after_the_onset_is_not_looked_at(dataset: Path) -> None:
    table = as_near_misses(Dataset(dataset), 100, 0)
    row = pl.int_range(pl.len()).over("interaction")
    onset = (pl.col("curvttc_causal") < 5.0).arg_max().over("interaction")
    late = pl.when(row > onset + AFTER).then(99.0).otherwise(pl.col("veh_speed"))
    assert table.select((row > onset + AFTER).any()).item()
    assert described(table.with_columns(veh_speed=late)) == pytest.approx(described(table), nan_ok=True)


def test_rejected_critical_episodes_belong_to_free_simulation(tmp_path: Path) -> None:
    speed = np.full(100, 5.0)
    values = np.zeros((2, 100, 10), np.float32)
    values[:, :, 0], values[:, :, 2] = np.cumsum(speed) * 0.05, speed
    values[:, :, 5] = -4.0
    values[..., 4] = 20.0
    values[..., 8], values[..., 9] = 10.0, 3.0
    for keep, number in ((False, 0), (True, 2)):
        with DatasetWriter(tmp_path / str(keep), {1: "one"}, {"period": 0.05}, keep_rejected=keep) as writer:
            writer.add(block_of_pairs(values))  # the pedestrian hardly moves
            writer.close()
        assert as_near_misses(Dataset(tmp_path / str(keep)), 100, 0)["interaction"].n_unique() == number


def test_free_simulation_stands_beside_each_source_of_the_recordings(
    dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = pl.when(pl.col("interaction") < 8).then(pl.lit("corner")).otherwise(pl.lit("campus"))
    table = synthetic_near_misses(interactions=16, seed=3).table.with_columns(source=place)
    monkeypatch.setattr(two_sample, "__kwdefaults__", two_sample.__kwdefaults__ | {"repetitions": 1})
    found = free(table, Dataset(dataset), 100, 0)
    assert set(found["described"]) == {"recorded", "generated", "recorded_corner", "recorded_campus"}
    assert found["interactions"]["recorded"] == sum(
        found["interactions"][f"recorded_{n}"] for n in ("corner", "campus")
    )
    assert set(found["c2st_auc"]) == {f"{what}{of}" for what in ("onset", "after") for of in ("", "_corner", "_campus")}
