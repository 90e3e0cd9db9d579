"""Simulated raters prove the statistics: guessing is chance, knowing is found, intervals cover what they promise."""

import numpy as np
import pytest
from extras.paper.turing.raters import simulated
from scipy import stats

from vpsci_ros.extras.paper.turing.agreement import icc_2k, mean_d_prime
from vpsci_ros.extras.paper.turing.crossed import over_both, over_raters, over_scenes, p_value, share_of, tost, welch
from vpsci_ros.extras.paper.turing.score import conclusion, correct, knowing_raters, score

SHROUT_FLEISS = np.array([[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]], float)
"""Four judges of six targets, table 2 of their paper."""


def test_icc_2k_is_that_of_the_example_of_shrout_and_fleiss() -> None:
    value, low, high = icc_2k(SHROUT_FLEISS.T)
    assert value == pytest.approx(0.62, abs=0.005)
    assert (low, high) == (pytest.approx(0.07, abs=0.01), pytest.approx(0.93, abs=0.01))


def test_paired_t_and_its_p_are_those_of_scipy() -> None:
    answers = simulated(np.random.default_rng(1))
    one, other = answers.realism[..., 2], answers.realism[..., 1]
    theirs = stats.ttest_rel(one.mean(axis=1), other.mean(axis=1))
    mine = over_raters(one - other)
    assert mine.value / mine.error == pytest.approx(theirs.statistic)
    assert p_value(mine) == pytest.approx(theirs.pvalue)
    interval = theirs.confidence_interval()
    assert (mine.low, mine.high) == (pytest.approx(interval.low), pytest.approx(interval.high))


def test_welch_and_its_equivalence_are_those_of_scipy() -> None:
    rng = np.random.default_rng(12)
    one, other = rng.normal(3.1, 0.6, 48), rng.normal(3.0, 1.1, 40)
    mine, theirs = welch(one, other), stats.ttest_ind(one, other, equal_var=False)
    assert mine.value / mine.error == pytest.approx(theirs.statistic)
    assert (mine.freedom, p_value(mine)) == (pytest.approx(theirs.df), pytest.approx(theirs.pvalue))
    interval = theirs.confidence_interval()
    assert (mine.low, mine.high) == (pytest.approx(interval.low), pytest.approx(interval.high))
    one_sided = (stats.ttest_ind(one + shift, other, equal_var=False, alternative=side).pvalue
                 for shift, side in ((0.5, "greater"), (-0.5, "less")))  # fmt: skip
    assert tost(mine, 0.5) == pytest.approx(max(one_sided))


def test_the_papers_own_analysis_leaves_out_raters_without_variance_and_with_bias_and_the_main_one_nobody() -> None:
    answers = simulated(np.random.default_rng(13), 12, 4, by_rater=0.1, by_scene=0.1, noise=0.9)
    answers.realism[2] = 4.0  # one score for everything
    answers.realism[7] -= 5.0  # everything far below what others say
    result = score(answers)
    own = result["as_the_paper"]
    assert own["excluded"]["rater 2"] == "scores hardly differ (deviation 0.00)"
    assert own["excluded"]["rater 7"].startswith("a mean of ")
    assert (own["raters"], result["raters"]) == (10, 12)
    row = next(row for row in own["table_11"] if row["second"] == "generated")
    kept = np.delete(answers.realism, [2, 7], axis=0)
    theirs = stats.ttest_ind(kept[..., 2].ravel(), kept[..., 1].ravel(), equal_var=False)
    assert (row["t"], row["freedom"]) == (pytest.approx(theirs.statistic), pytest.approx(theirs.df))
    assert row["conclusion"] == "different"


def test_intervals_cover_the_truth_as_often_as_they_promise() -> None:
    rng = np.random.default_rng(3)
    inside = {"raters": 0, "scenes": 0, "both": 0}
    runs = 600
    for _ in range(runs):  # differences of realism whose true mean is 0.3
        of_raters, of_scenes = rng.normal(0.0, 0.5, (15, 1)), rng.normal(0.0, 0.4, (1, 8))
        noise = rng.normal(0.0, 1.1, (15, 8))
        for name, table, mean in (("raters", 0.3 + of_raters + noise, over_raters),
                                  ("scenes", 0.3 + of_scenes + noise, over_scenes),
                                  ("both", 0.3 + of_raters + of_scenes + noise, over_both)):  # fmt: skip
            found = mean(table)
            inside[name] += found.low <= 0.3 <= found.high
    assert inside["raters"] / runs == pytest.approx(0.95, abs=0.03)
    assert inside["scenes"] / runs == pytest.approx(0.95, abs=0.03)
    assert 0.93 <= inside["both"] / runs <= 0.99


def test_intervals_of_shares_stay_within_0_and_1_and_cover_the_truth_as_often() -> None:
    rng, inside = np.random.default_rng(31), 0
    for _ in range(600):  # 9 of 10 clips of each scene are recognised on average, by the few raters of a first try
        skill = np.clip(rng.normal(0.9, 0.05, (4, 1)), 0.0, 1.0)
        table = 0.5 * rng.binomial(2, skill, (4, 6))
        found = share_of(over_both(table), 4)
        assert 0.0 <= found.low <= table.mean() <= found.high <= 1.0
        inside += found.low <= 0.9 <= found.high
    assert inside / 600 >= 0.93
    for skill in (0.0, 4.0):
        result = score(simulated(rng, 3, 4, skill=skill))
        for mean in [*result["rated_real"].values(), *(each["accuracy"] for each in result["recognised"].values())]:
            for of in (mean, mean["by_rater"], mean["by_scene"]):
                assert 0.0 <= of["low"] <= of["value"] <= of["high"] <= 1.0


def test_guessing_raters_score_at_chance_and_are_not_found_out() -> None:
    rng = np.random.default_rng(5)
    found = [simulated(rng, skill=0.0) for _ in range(100)]
    accuracies = [over_both(correct(answers, "generated")) for answers in found]
    assert np.mean([a.value for a in accuracies]) == pytest.approx(0.5, abs=0.015)
    assert np.mean([p_value(a, 0.5) < 0.05 for a in accuracies]) <= 0.09
    assert np.mean([any(row["knows"] for row in knowing_raters(answers)) for answers in found]) <= 0.06
    d = [mean_d_prime(answers.real[..., 0], answers.real[..., 1]).value for answers in found]
    assert np.mean(d) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(
    ("effect", "by_scene", "expected"),
    [((0.0, 0.0, -1.5), 0.1, "equivalent"), ((0.0, -1.2, -2.0), 0.1, "different"), ((0.0, -0.4, -1.5), 1.0, "open")],
)
def test_table_11_concludes_what_is_true_and_no_more(effect, by_scene, expected) -> None:
    answers = simulated(np.random.default_rng(8), 40, 10, effect, by_rater=0.2, by_scene=by_scene)
    rows = {(row["first"], row["second"]): row for row in score(answers)["table_11"]}
    assert rows["generated", "recorded"]["conclusion"] == expected
    assert rows["rule_based", "recorded"]["paper"]["conclusion"] == "different"


def test_false_equivalence_is_concluded_no_more_often_than_its_level() -> None:
    rng = np.random.default_rng(9)
    concluded = 0
    for _ in range(200):  # truly at the margin
        answers = simulated(rng, 20, 8, (0.0, -0.5, 0.0), by_rater=0.2, by_scene=0.2)
        concluded += "equivalent" in conclusion(over_both(answers.realism[..., 1] - answers.realism[..., 0]))
    assert concluded / 200 <= 0.08
