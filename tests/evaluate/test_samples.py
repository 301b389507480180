"""Scores of samples by hand and against closed forms."""

import numpy as np
import pytest

from rampcast.evaluate.samples import energy_scores, pit, pit_deviation

RNG = np.random.default_rng(5)


def test_the_energy_score_of_two_samples_is_what_a_hand_finds():
    """Samples (0, 0) and (3, 4), truth (0, 0): distances 0 and 3 in the first place, 0 and 5 in both.

    Means 1.5 and 2.5; two samples are 3 and 5 apart: 1.5 - 1.5 = 0 and (2.5 - 2.5) / sqrt 2 = 0. With truth (3, 0):
    3 and 0, then 3 and 4, so 1.5 - 1.5 = 0 and (3.5 - 2.5) / sqrt 2.
    """
    samples = np.array([[[0.0, 0.0], [3.0, 4.0]]])
    np.testing.assert_allclose(energy_scores(samples, np.array([[0.0, 0.0]])), [[0.0, 0.0]])
    np.testing.assert_allclose(energy_scores(samples, np.array([[3.0, 0.0]])), [[0.0, 1.0 / np.sqrt(2.0)]])


def test_the_energy_score_of_one_sample_is_its_root_mean_square_error():
    sample, truth = np.array([[[1.0, 5.0, 2.0]]]), np.array([[0.0, 3.0, np.nan]])
    np.testing.assert_allclose(energy_scores(sample, truth), [[1.0, np.sqrt(5.0 / 2.0), np.nan]])


def test_the_energy_score_of_one_component_is_the_crps_of_the_normal_law():
    """CRPS of a standard normal forecast at 0: 2 phi(0) - 1 / sqrt(pi) = 0.2337. Source: Gneiting and Raftery 2007."""
    samples = RNG.normal(size=(40, 2000, 1))
    found = energy_scores(samples, np.zeros((40, 1))).mean()
    assert found == pytest.approx(2.0 / np.sqrt(2.0 * np.pi) - 1.0 / np.sqrt(np.pi), abs=0.005)


def test_samples_that_move_together_as_the_truth_does_score_better_than_the_same_ones_shuffled():
    truth = np.cumsum(RNG.normal(size=(300, 5)), axis=1)
    samples = np.cumsum(RNG.normal(size=(300, 100, 5)), axis=2)
    shuffled = np.stack([RNG.permutation(samples[:, :, k], axis=1) for k in range(5)], axis=2)
    together, apart = energy_scores(samples, truth), energy_scores(shuffled, truth)
    np.testing.assert_allclose(together[:, 0].mean(), apart[:, 0].mean(), rtol=0.05)
    assert together[:, 4].mean() < apart[:, 4].mean()


def test_the_pit_is_the_share_of_samples_below_and_half_of_those_equal():
    samples = np.array([[1.0, 2.0, 2.0, 5.0], [1.0, 2.0, 3.0, np.nan]])
    np.testing.assert_allclose(pit(samples, np.array([2.0, 2.0])), [0.5, np.nan])
    np.testing.assert_allclose(pit(samples[:1], np.array([9.0])), [1.0])
    assert pit_deviation(np.array([0.0, 0.05, 0.1, 1.0, np.nan])) == pytest.approx(0.7)  # shares .5, .25 and .25


def test_the_pit_of_a_calibrated_forecast_is_uniform():
    values = pit(RNG.normal(size=(4000, 99)), RNG.normal(size=4000))
    assert pit_deviation(values) < 0.03
