"""The energy score is the ADE of one roll-out, is least for the true distribution, and does not depend on K."""

import itertools

import numpy as np
import pytest

from vpsci_ros.evaluation.roll_out_scores import energy_score, errors
from vpsci_ros.extras.paper.min_ade import min_ade


def test_the_energy_score_by_hand() -> None:
    recorded = np.zeros((1, 2, 1, 2))
    positions = np.zeros((1, 3, 2, 1, 2))
    positions[0, :, :, 0, 0] = np.array([[1.0], [2.0], [4.0]])
    # errors 1, 2, 4; distances of pairs 1, 2, 3: 7/3 - 2/2
    assert energy_score(positions, recorded) == pytest.approx([7 / 3 - 1.0])


def test_the_true_spread_scores_better_than_less_or_more_of_it(rng: np.random.Generator) -> None:
    n, count = 400, 16
    recorded = rng.normal(size=(n, 2, 1, 2))
    mean = {
        spread: energy_score(spread * rng.normal(size=(n, count, 2, 1, 2)), recorded).mean()
        for spread in (0.0, 0.6, 1.0, 1.7)
    }
    assert min(mean, key=lambda spread: mean[spread]) == 1.0


def test_min_ade_is_the_mean_over_all_choices_of_six(rng: np.random.Generator) -> None:
    recorded, positions = rng.normal(size=(2, 2, 5, 2)), rng.normal(size=(2, 9, 2, 5, 2))
    each = errors(positions, recorded)
    by_hand = np.mean([each[:, list(choice)].min(axis=1) for choice in itertools.combinations(range(9), 6)], axis=0)
    assert min_ade(positions, recorded) == pytest.approx(by_hand)
