"""Whose reactions act at recorded onsets, and which onsets lie beyond their range."""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from synthetic import synthetic_near_misses

from vpsci_ros.cli.dataset import generate
from vpsci_ros.cli.exam import ads_test
from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.onsets import find_onsets
from vpsci_ros.evaluation.simulators import beyond_range
from vpsci_ros.extras.paper.realism.run import run_realism
from vpsci_ros.policy.bank import Bank
from vpsci_ros.policy.policy_file import load_policy


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


@pytest.mark.parametrize("command", [generate, ads_test])
def test_a_source_that_the_bank_does_not_have_is_refused_before_anything_runs(command: Any, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="expected one of cqut, vci, the sources of this bank, got 'nobody'"):
        command(output=tmp_path / "out", people="nobody", episodes=1)
    assert not list((tmp_path / "out").glob("*.json"))


def test_realism_refuses_it_too(tmp_path: Path) -> None:
    options = {"library": None, "weights": None, "dataset": None, "json_path": None, "output": None}
    with pytest.raises(InvalidInput, match="got 'nobody'"):
        run_realism(
            data=Path("right_turns/dev"), people="nobody", held_out=False, clean=False, seed=0, quiet=True, **options
        )
