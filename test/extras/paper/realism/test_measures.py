"""Onsets are causal and whole; recordings are likelier than controls, and the classifier tells who is who."""

import numpy as np
import polars as pl
import pytest
from extras.paper.realism.straight import constant_velocity
from synthetic import synthetic_near_misses

from vpsci_ros.errors import InvalidInput
from vpsci_ros.evaluation.onsets import HISTORY, STEPS, Onsets, find_onsets
from vpsci_ros.evaluation.roll_out_scores import energy_score
from vpsci_ros.evaluation.simulators import residual_sampler
from vpsci_ros.extras.paper.realism.features import features, with_borrowed_noise
from vpsci_ros.extras.paper.realism.likelihood import likelihoods
from vpsci_ros.extras.paper.realism.two_sample import two_sample

CLIPS_OF = 4  # synthetic encounters that are to count as a clip


def as_clips(onsets: Onsets) -> np.ndarray:
    return np.array([f"clip_{i // CLIPS_OF}" for i in range(len(onsets))])


def test_an_onset_is_the_first_causally_critical_step_with_a_second_before_and_three_after(onsets: Onsets) -> None:
    table = synthetic_near_misses(interactions=40, seed=3).table
    for i, number in enumerate(onsets.number[:5]):
        own = table.filter(pl.col("interaction") == number)
        at = int((own["curvttc_causal"].to_numpy() < 5.0).argmax())
        assert onsets.interactions.first[i] == min(at, HISTORY)
        assert onsets.start[i, 0] == own["veh_x"][at]
        assert onsets.recorded[i, 1, -1, 1] == own["ped_y"][at + STEPS]
        assert onsets.interactions.curvttc[i, onsets.interactions.first[i]] == own["curvttc_causal"][at]


def test_a_table_that_ends_too_early_has_no_onset() -> None:
    table = synthetic_near_misses(interactions=4, seed=3).table
    onset = (pl.col("curvttc_causal") < 5.0).arg_max().over("interaction")
    cut = table.filter(pl.int_range(pl.len()).over("interaction") < onset + STEPS)
    with pytest.raises(InvalidInput, match="expected an interaction with 3 s of whole track after its onset, got none"):
        find_onsets(cut)


def test_what_happened_is_likelier_under_itself_than_under_constant_velocity(onsets: Onsets) -> None:
    itself = likelihoods(onsets.recorded[:, None], onsets)["all"]
    control = likelihoods(constant_velocity(onsets), onsets)["all"]
    assert (itself <= 1.0).all()
    assert itself.mean() > 1.2 * control.mean()


def test_a_collision_that_nobody_had_costs_a_quarter_of_the_likelihood(onsets: Onsets) -> None:
    through = onsets.recorded[:, None].copy()
    through[:, :, 1] = through[:, :, 0]
    itself = likelihoods(onsets.recorded[:, None], onsets)["collision"]
    assert likelihoods(through, onsets)["collision"].mean() < 0.2 < itself.mean()


def test_the_residuals_of_others_score_better_than_their_middle(onsets: Onsets) -> None:
    middle = constant_velocity(onsets)
    sampled = residual_sampler(onsets, onsets, middle, middle)
    assert energy_score(sampled, onsets.recorded).mean() < 0.9 * energy_score(middle, onsets.recorded).mean()


def test_the_classifier_finds_constant_velocity_and_not_a_fresh_half_of_the_recordings(onsets: Onsets) -> None:
    clips = as_clips(onsets)
    recorded = {name: value[:, 0] for name, value in features(onsets.recorded[:, None], onsets).items()}
    control = features(with_borrowed_noise(constant_velocity(onsets), onsets, 0), onsets)
    found = two_sample(recorded, [control], (clips, clips), 0, repetitions=3)
    assert found.auc > 0.9
    assert found.auc_interval[0] <= found.auc <= found.auc_interval[1]
    half = np.arange(len(onsets)) % 2 == 0
    one = {name: value[half] for name, value in recorded.items()}
    other = {name: value[~half, None] for name, value in recorded.items()}
    apart = two_sample(one, [other], (clips[half], clips[~half]), 0, paired=False, repetitions=3)
    assert abs(apart.auc - 0.5) < 0.25


def test_one_clip_cannot_be_separated(onsets: Onsets) -> None:
    of = features(onsets.recorded[:, None], onsets)
    one = np.full(len(onsets), "one")
    with pytest.raises(InvalidInput, match="two clips or vehicles"):
        two_sample({name: value[:, 0] for name, value in of.items()}, [of], (one, one), 0)
    with pytest.raises(InvalidInput, match="generated episodes of two scenarios, got one"):
        two_sample({name: value[:, 0] for name, value in of.items()}, [of], (as_clips(onsets), one), 0, paired=False)
