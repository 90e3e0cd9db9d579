"""All protocols in one run, resumed from its parts."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from extras.paper.realism.straight import constant_velocity
from rich.console import Console
from synthetic import block_of_pairs, synthetic_near_misses

from vpsci_ros.data.dataset import DatasetWriter, write_blocks
from vpsci_ros.data.dataset_reader import Dataset
from vpsci_ros.documents import read_json
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.onsets import Onsets, borrowable, find_onsets
from vpsci_ros.extras.paper.realism.controls import CONTROLS, constant_turn
from vpsci_ros.extras.paper.realism.free import as_near_misses, free
from vpsci_ros.extras.paper.realism.measure_realism import beyond_range, drawn, measure_realism, run_realism
from vpsci_ros.extras.paper.realism.same_start import SameStart
from vpsci_ros.extras.paper.realism.text import print_realism
from vpsci_ros.extras.paper.realism.two_sample import two_sample
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.policy_file import load_policy
from vpsci_ros.runs.files import write_json


def noisy(onsets: Onsets) -> np.ndarray:
    """Roll-outs: the recording with one shift each."""
    shift = np.random.default_rng(0).normal(size=(len(onsets), 4, 2, 1, 2))
    return onsets.recorded[:, None] + shift


@pytest.fixture
def one_repetition(monkeypatch: pytest.MonkeyPatch) -> None:
    """The least that a classifier does: nothing here asserts how well it tells anything apart."""
    monkeypatch.setattr("vpsci_ros.extras.paper.realism.same_start.FAMILY_REPETITIONS", 1)
    monkeypatch.setattr("vpsci_ros.extras.paper.realism.two_sample.FOLDS", 2)


def test_a_run_measures_controls_and_models_and_goes_on_from_its_parts(tmp_path: Path, one_repetition: None) -> None:
    place = pl.when(pl.col("interaction") < 8).then(pl.lit("here")).otherwise(pl.lit("there"))
    table = synthetic_near_misses(interactions=16, seed=3).table.with_columns(source=place)
    reported: list[tuple[str, int, int]] = []

    def measure() -> dict[str, Any]:
        options = {"parts": tmp_path, "inputs": {"weights": "1f"}}
        options |= {"notify": lambda *told: reported.append(told)}
        return measure_realism(table, {"noisy": noisy}, repetitions=1, **options)["same_start"]

    found = measure()
    models = found["models"]
    assert list(models) == [*CONTROLS, "noisy"]
    assert list(dict.fromkeys(name for name, *_ in reported)) == ["onsets", *models]
    done, total = [count for _, count, _ in reported], reported[0][2]
    assert done == sorted(done)
    assert total - 2 < done[-1] + 1 <= total, "the last test of the last model is under way"
    assert models["recorded"]["energy_score"] == pytest.approx(0.0, abs=1e-12)
    assert models["constant_velocity_tracked"]["of_constant_velocity"] == pytest.approx(1.0)
    assert models["recorded"]["likelihood"] > models["constant_velocity_tracked"]["likelihood"]
    assert models["noisy"]["roll_outs"] == 4
    assert found["not_in_library"] == []
    path = tmp_path / "same_start_noisy.part.json"
    write_json(path, read_json(path) | {"found": {"kept": True}})
    assert measure()["models"]["noisy"] == {"kept": True}
    write_json(path, {"inputs_sha256": {"weights": "2e"}, "found": {"kept": True}})
    assert measure()["models"]["noisy"] == models["noisy"], "what was measured of other weights was kept"
    path.write_text(path.read_text()[:100])
    assert measure()["models"]["noisy"] == models["noisy"], "what is damaged was kept"


def test_a_finished_run_is_printed_uncut_and_its_numbers_are_written_where_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    widths: list[int] = []
    module = "vpsci_ros.extras.paper.realism.measure_realism"
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(f"{module}.measure_realism", lambda *_, **__: {"found": 1})
    monkeypatch.setattr(f"{module}.print_realism", lambda _, console: widths.append(console.width))
    for json_path in (None, tmp_path / "again.json"):
        run_realism(
            data=Path("right_turns/dev"), library=None, weights=None, people=None, dataset=None, held_out=False,
            clean=False, onsets=2, seed=0, json_path=json_path, output=tmp_path / "run", quiet=True,
        )  # fmt: skip
    assert read_json(tmp_path / "again.json") == read_json(tmp_path / "run" / "realism.json")
    assert widths == [130, 130], "of the widest table, in a terminal of 60 characters"


def test_the_onsets_that_are_measured_can_be_capped_and_the_seed_draws_them(onsets: Onsets) -> None:
    few, again, other = drawn(onsets, 7, 1), drawn(onsets, 7, 1), drawn(onsets, 7, 2)
    assert len(set(few.number)) == 7
    assert (few.number == np.sort(few.number)).all()
    assert (few.number == again.number).all()
    assert (few.number != other.number).any()
    assert drawn(onsets, None, 1) is drawn(onsets, 10**6, 1) is onsets


def test_each_source_has_donors_of_its_own() -> None:
    place = pl.when(pl.col("interaction") < 8).then(pl.lit("here")).otherwise(pl.lit("there"))
    onsets = find_onsets(synthetic_near_misses(interactions=16, seed=3).table.with_columns(source=place))
    allowed = borrowable(onsets, onsets)
    assert (onsets.source[:, None] == onsets.source[None])[allowed].all()
    assert not np.diag(allowed).any()
    foreign = SameStart(onsets.take(np.flatnonzero(onsets.source == "here")), onsets.take(np.array([15])), 0)
    assert foreign.missing == ["here"]  # the only one in the library is from there


def test_one_long_recording_is_measured_by_its_groups(one_repetition: None, capsys: pytest.CaptureFixture[str]) -> None:
    table = synthetic_near_misses(interactions=12, seed=3).table.with_columns(clip=pl.lit("long"))
    same = pl.when(pl.col("interaction") < 2).then(0).otherwise(pl.col("interaction"))
    table = table.with_columns(group=same)  # the first two are of one vehicle
    onsets = find_onsets(table)
    allowed = borrowable(onsets, onsets)
    of_one = np.isin(onsets.number, (0, 1))
    assert (allowed == ~(np.eye(len(onsets), dtype=bool) | (of_one[:, None] & of_one))).all()
    found = measure_realism(table, {"noisy": noisy}, repetitions=1)
    units = f"{len(onsets) - of_one.sum() + 1} groups"
    assert (found["same_start"]["clips"], found["same_start"]["units"]) == (1, units)
    for name in ("constant_turn", "residual_sampler", "noisy"):
        low, high = found["same_start"]["models"][name]["energy_score_interval"]
        assert low < found["same_start"]["models"][name]["energy_score"] < high
    print_realism(found, Console(width=130))
    printed = " ".join(capsys.readouterr().out.split())
    assert "in folds by group" in printed
    assert "…" not in printed  # no cell is cut
    assert f"Intervals: 95%, {units} resampled." in printed
    alone = find_onsets(table.with_columns(group=pl.lit(0)))
    with pytest.raises(InvalidInput, match="expected those of two vehicles or more"):
        borrowable(alone, alone)


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
        measure_realism(table, {"recorded": noisy}, repetitions=1)


def test_rejected_critical_episodes_belong_to_free_simulation(tmp_path: Path) -> None:
    speed = np.full(100, 5.0)
    values = np.zeros((2, 100, 10), np.float32)
    values[:, :, 0], values[:, :, 2] = np.cumsum(speed) * 0.05, speed
    values[:, :, 5] = -4.0
    values[..., 4] = 20.0
    values[..., 8], values[..., 9] = 10.0, 3.0
    for keep, number in ((False, 0), (True, 2)):
        with DatasetWriter(tmp_path / str(keep), {1: "one"}, {"period": 0.05}, keep_rejected=keep) as writer:
            write_blocks(writer, [block_of_pairs(values)])  # the pedestrian hardly moves
            writer.close()
        assert as_near_misses(Dataset(tmp_path / str(keep)), 100, 0)["interaction"].n_unique() == number


def test_free_simulation_is_compared_at_the_onset_and_after_it(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(two_sample, "__kwdefaults__", two_sample.__kwdefaults__ | {"repetitions": 1})
    monkeypatch.setattr("vpsci_ros.extras.paper.realism.free.REPETITIONS", 1)
    table = synthetic_near_misses(interactions=16, seed=3).table
    found = free(table, Dataset(dataset), 100, 0)
    assert set(found["c2st_auc"]) == {"onset", "after"}
    assert set(found["long_run"]) == {"recorded", "generated"}
    assert found["interactions"]["generated"] == 6
    assert found["units"] == "16 clips"


def test_each_source_answers_its_own_onsets_another_one_the_rest_and_a_named_one_all() -> None:
    place = pl.when(pl.col("interaction") < 8).then(pl.lit("vci-dut")).otherwise(pl.lit("somewhere"))
    onsets = find_onsets(synthetic_near_misses(interactions=16, seed=3).table.with_columns(source=place))
    bank = load_policy("people")
    assert isinstance(bank, Bank)
    sources, _ = beyond_range(bank, onsets)
    assert sources.tolist() == np.where(onsets.source == "vci-dut", "vci", "cqut").tolist()
    assert set(beyond_range(bank, onsets, "vci")[0]) == {"vci"}
    with pytest.raises(InvalidInput, match="expected one of cqut, vci, the sources of this bank, got 'nobody'"):
        beyond_range(bank, onsets, "nobody")


def test_an_onset_is_held_against_the_range_of_the_source_that_answers_it() -> None:
    onsets = find_onsets(synthetic_near_misses(interactions=16, seed=3).table)
    bank = load_policy("people")
    assert isinstance(bank, Bank)
    wide, narrow = np.repeat([[0.0, 1e9]] * 4, [1, 4], axis=1), np.full((4, 5), 1e9)
    made = {
        name: own._replace(reach=reach)
        for (name, own), reach in zip(bank.reactions.items(), (wide, narrow), strict=True)
    }
    assert not beyond_range(Bank(made), onsets)[1].any()
    assert beyond_range(Bank(made), onsets, "vci")[1].all()
