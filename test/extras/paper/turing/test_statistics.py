"""The statistics of section 4.4 on simulated raters, against SciPy and an example of the literature."""

import numpy as np
import pytest
from extras.paper.turing.raters import simulated
from scipy import stats

from vpsci_ros.extras.paper.turing.agreement import icc_2k
from vpsci_ros.extras.paper.turing.score import conclusion, score

SHROUT_FLEISS = np.array([[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]], float)
"""Four judges of six targets, table 2 of their paper."""


def test_icc_2k_is_that_of_the_example_of_shrout_and_fleiss() -> None:
    value, low, high = icc_2k(SHROUT_FLEISS.T)
    assert value == pytest.approx(0.62, abs=0.005)
    assert (low, high) == (pytest.approx(0.07, abs=0.01), pytest.approx(0.93, abs=0.01))


def test_table_11_leaves_out_raters_without_variance_and_with_bias_and_the_means_nobody() -> None:
    answers = simulated(np.random.default_rng(13), 12, 4, by_rater=0.1, by_scene=0.1, noise=0.9)
    answers.realism[2] = 4.0  # one score for everything
    answers.realism[7] -= 5.0  # everything far below what others say
    result = score(answers)
    assert result["excluded"]["rater 2"] == "scores hardly differ (deviation 0.00)"
    assert result["excluded"]["rater 7"].startswith("a mean of ")
    assert (result["kept"], result["raters"]) == (10, 12)
    assert result["realism"]["generated"] == pytest.approx(answers.realism[..., 1].mean())
    row = next(row for row in result["table_11"] if row["second"] == "generated")
    kept = np.delete(answers.realism, [2, 7], axis=0)
    theirs = stats.ttest_ind(kept[..., 2].ravel(), kept[..., 1].ravel(), equal_var=False)
    interval = theirs.confidence_interval()
    for name, value in {"t": theirs.statistic, "freedom": theirs.df, "p": theirs.pvalue, "low": interval.low}.items():
        assert row[name] == pytest.approx(value), name
    near = next(row for row in result["table_11"] if row["first"] == "generated")
    one, other = kept[..., 1].ravel(), kept[..., 0].ravel()
    sides = [stats.ttest_ind(one + shift, other, equal_var=False, alternative=side).pvalue
             for shift, side in ((0.5, "greater"), (-0.5, "less"))]  # fmt: skip
    assert near["tost"] == pytest.approx(max(sides))
    assert row["conclusion"] == "different"


@pytest.mark.parametrize(("effect", "expected"), [((0.0, 0.0, -1.5), "equivalent"), ((0.0, -1.2, -2.0), "different")])
def test_table_11_concludes_what_is_true_of_these_scenes(effect, expected) -> None:
    answers = simulated(np.random.default_rng(8), 40, 10, effect, by_rater=0.2, by_scene=0.1)
    rows = {(row["first"], row["second"]): row for row in score(answers)["table_11"]}
    assert rows["generated", "recorded"]["conclusion"] == expected
    assert rows["rule_based", "recorded"]["paper"]["conclusion"] == "different"


def test_neither_a_difference_nor_equivalence_shown_is_open() -> None:
    assert conclusion(0.2, 0.2) == "open"
    assert conclusion(0.01, 0.01) == "equivalent, and different"


def test_without_two_raters_there_is_no_agreement_and_no_error() -> None:
    result = score(simulated(np.random.default_rng(1), 1, 4))
    assert result["icc_2k"] == [None] * 3
    alike = simulated(np.random.default_rng(1), 2, 4)
    alike.realism[:] = 4.0
    assert score(alike)["table_11"] == []
