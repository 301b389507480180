"""Recalibration on made-up traffic whose forecasts are wrong by as much as they should not be."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.forecast.recalibration import (
    FEWEST,
    HORIZONS,
    LEVELS,
    MEMORY,
    NARROWEST,
    STEPS,
    TARGET,
    WIDEST,
    Issued,
    Recalibration,
    Scores,
)
from rampcast.horizon import FUTURE, STEP

SAID = 1.0  # [m/s^0.5] spread that forecasts say: their standard deviation at t is SAID * sqrt(t)
Z = 1.6449  # of the 95 % quantile of a normal distribution
VEHICLES = 12
SPEED = 10.0


def bands(x: np.ndarray) -> np.ndarray:
    """Returns the bands of vehicles that keep their speed, at the spread that they are said to have."""
    middle = x[:, None] + SPEED * HORIZONS
    half = Z * SAID * np.sqrt(HORIZONS)
    return middle[..., None] + half[:, None] * np.array([-1.0, 0.0, 1.0])


def driven(spread: Callable[[float], float], *, seconds: int, seed: int = 0) -> tuple[Recalibration, list[Scores]]:
    """Returns the state after vehicles have driven with random speeds of that spread at each time, and all scores."""
    rng, x, state = np.random.default_rng(seed), np.linspace(0.0, 3000.0, VEHICLES), Recalibration()
    ids = np.arange(VEHICLES)
    scores = []
    for second in range(seconds):
        state = state.seen(float(second), ids, x)
        scores.append(state.scores.since(second - 0.5))
        state = state.issued(float(second), ids, bands(x))
        x = x + SPEED + spread(float(second)) * rng.normal(size=VEHICLES)
    return state, scores


def coverage(scores: list[Scores], horizon: int) -> float:
    inside = [one.score[one.horizon == horizon] <= one.factor[one.horizon == horizon] for one in scores]
    return float(np.concatenate(inside).mean())


def test_a_new_state_leaves_bands_alone():
    assert Recalibration().factors.tolist() == [1.0] * len(HORIZONS)
    samples = np.random.default_rng(0).normal(size=(3, 20, FUTURE))
    np.testing.assert_allclose(Recalibration().apply(samples), samples, rtol=0, atol=1e-12)
    assert (Recalibration().report()["n"] == 0).all()


@pytest.mark.slow
def test_good_bands_stay_as_they_are():
    state, _ = driven(lambda _: SAID, seconds=600)
    np.testing.assert_allclose(state.factors, 1.0, atol=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("spread", [2.0, 0.6])
def test_the_coverage_of_bands_of_a_wrong_width_returns_to_nine_tenths(spread):
    """The forecasts say a spread of 1: bands of 90 % would hold 59 % of the truths of spread 2, and 99 % at 0.6."""
    state, scores = driven(lambda _: spread, seconds=700)
    report = state.report()
    assert report["coverage_unscaled"][0] == pytest.approx({2.0: 0.59, 0.6: 0.994}[spread], abs=0.03)
    for number in range(len(HORIZONS)):
        assert coverage(scores[350:], number) == pytest.approx(0.9, abs=0.04), HORIZONS[number]
    np.testing.assert_allclose(state.factors, spread, rtol=0.2)
    np.testing.assert_allclose(report["coverage"], 0.9, atol=0.04)


@pytest.mark.slow
def test_the_coverage_returns_when_the_traffic_drifts_all_the_time():
    """The spread rises from what is said to 2.8 times that in 15 minutes: at the end half are held unscaled."""
    state, scores = driven(lambda second: SAID * (1.0 + second / 500.0), seconds=900)
    assert state.report()["coverage_unscaled"][0] < 0.55
    for number in range(len(HORIZONS)):
        assert coverage(scores[300:], number) == pytest.approx(0.9, abs=0.04), HORIZONS[number]


@pytest.mark.slow
def test_alpha_makes_up_for_what_the_scores_of_the_last_minutes_do_not_know_yet():
    """While the spread rises the scores of the last minutes are too small: alpha is below the target."""
    rising, _ = driven(lambda second: SAID * (1.0 + second / 300.0), seconds=600)
    assert (rising.alpha < TARGET).all()


def test_a_step_is_that_of_gibbs_and_candes():
    """4 of 10 truths of the first horizon were missed: 0.1 + 0.005 (0.1 - 0.4), however close the frames are."""
    ids, x = np.arange(10), np.zeros(10)
    state = Recalibration().seen(0.0, ids, x).issued(0.0, ids, bands(x))
    truth = SPEED + np.where(ids < 4, 2.0 * Z * SAID, 0.0)
    after = state.seen(0.9, ids, 0.9 * truth).seen(1.0, ids, truth)
    assert after.alpha[0] == pytest.approx(0.1 + 0.005 * (0.1 - 0.4))
    assert after.alpha[1:].tolist() == [TARGET] * (len(HORIZONS) - 1)
    assert state.alpha[0] == TARGET  # what was passed is as it was
    assert len(state.scores.score) == 0
    np.testing.assert_allclose(after.scores.score, np.where(ids < 4, 2.0, 0.0))


def test_a_truth_between_two_frames_lies_between_their_places():
    """Due at 1 s; seen at 0.8 s at 6 m and at 1.3 s at 16 m: 10 m. A vehicle that one frame lacks has no truth."""
    ids = np.array([7, 3])
    state = Recalibration().issued(0.0, ids, bands(np.zeros(2)))
    state = state.seen(0.8, np.array([3, 5]), np.array([6.0, 0.0])).seen(1.3, np.array([7, 3]), np.array([50.0, 16.0]))
    assert state.scores.score.tolist() == pytest.approx([0.0], abs=1e-9)
    assert state.scores.time.tolist() == [1.3]


def test_a_truth_in_a_hole_of_frames_and_frames_of_the_past_count_for_nothing():
    ids, x = np.arange(3), np.zeros(3)
    state = Recalibration().seen(0.0, ids, x).issued(0.0, ids, bands(x))
    assert len(state.seen(2.5, ids, x).scores.score) == 0
    again = state.seen(0.0, ids, x + 100.0)
    np.testing.assert_array_equal(again.last.x, x)


@pytest.mark.slow
def test_forecasts_soon_after_another_are_passed_over_and_old_ones_forgotten():
    ids, x = np.arange(2), np.zeros(2)
    state = Recalibration()
    for tick in range(200):
        state = state.seen(tick * STEP, ids, x).issued(tick * STEP, ids, bands(x))
    assert [one.t0 for one in state.pending] == pytest.approx(np.arange(25.0, 40.0).tolist())
    long, _ = driven(lambda _: SAID, seconds=int(MEMORY) + 100)
    assert long.scores.time.min() > MEMORY + 99 - MEMORY


def test_factors_have_limits_and_few_scores_change_nothing():
    def state(score: float, count: int) -> Recalibration:
        zero = np.zeros(count)
        return Recalibration(scores=Scores(zero, zero.astype(np.int64), np.full(count, score), np.ones(count)))

    assert state(50.0, FEWEST).factors[0] == WIDEST
    assert state(0.0, FEWEST).factors[0] == NARROWEST
    assert state(50.0, FEWEST - 1).factors[0] == 1.0


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(NARROWEST, WIDEST), min_size=len(HORIZONS), max_size=len(HORIZONS)), st.integers(0, 99))
def test_samples_keep_their_order_and_median_and_bands_are_scaled_at_the_horizons(factors, seed):
    scores = Scores(
        np.zeros(FEWEST * len(HORIZONS)),
        np.repeat(np.arange(len(HORIZONS)), FEWEST),
        np.repeat(factors, FEWEST),
        np.ones(FEWEST * len(HORIZONS)),
    )
    samples = np.random.default_rng(seed).normal(100.0, 5.0, (4, 31, FUTURE))
    found = Recalibration(scores=scores).apply(samples)
    np.testing.assert_array_equal(np.argsort(found, axis=1), np.argsort(samples, axis=1))
    np.testing.assert_allclose(np.median(found, axis=1), np.median(samples, axis=1))
    before, after = (np.quantile(one[:, :, STEPS], LEVELS, axis=1) for one in (samples, found))
    np.testing.assert_allclose(after - before[1], np.array(factors) * (before - before[1]), atol=1e-9)


def test_a_forecast_without_vehicles_and_a_frame_without_any_are_no_errors():
    nobody, nowhere = np.empty(0, dtype=np.int64), np.empty(0)
    state = Recalibration().seen(0.0, nobody, nowhere).issued(0.0, nobody, np.empty((0, len(HORIZONS), 3)))
    state = state.seen(1.0, nobody, nowhere).seen(2.0, np.arange(2), np.zeros(2))
    assert state.factors.tolist() == [1.0] * len(HORIZONS)
    assert isinstance(state.pending[0], Issued)
