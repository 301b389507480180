"""The forecaster of merge scenes: its contracts, what its samples say of merges, and scenes without a lane to merge."""

from dataclasses import replace

import numpy as np
import pytest

from rampcast.forecast.merge_roll_out import MergeSamples
from rampcast.forecast.platoon_forecaster import PlatoonForecasterSpec
from rampcast.forecast.scene_forecaster import GAPS, fit_scene_forecaster, sample_quantiles
from rampcast.horizon import FUTURE, STEP
from rampcast.models.correction import CorrectionSpec
from rampcast.traffic.merge_scenes import without_target
from tests.forecast.merges_made_up import LENGTH, merges

pytestmark = pytest.mark.slow

SPEC = PlatoonForecasterSpec(samples=20, folds=3, correction=CorrectionSpec(trees=10))


def fitted(made, *, spec=SPEC):
    return fit_scene_forecaster(
        made.scenes,
        made.truth,
        made.leader_truth,
        change_time=made.change_time,
        seen_for=made.seen_for,
        group=made.group,
        t0=made.t0,
        spec=spec,
    )


@pytest.fixture(scope="module")
def model():
    return fitted(merges(150, seed=1))


@pytest.fixture(scope="module")
def test():
    return merges(64, seed=2)


@pytest.fixture(scope="module")
def forecast(model, test):
    return model.predict(test.scenes)


def test_curves_are_the_shares_of_the_samples(forecast):
    for step in (0, 10, 74):
        np.testing.assert_allclose(forecast.p_within[:, step], (forecast.merge_step <= step).mean(axis=1))
        np.testing.assert_allclose(forecast.p_at[:, step], (forecast.merge_step == step).mean(axis=1), atol=1e-12)
    assert (np.diff(forecast.p_within, axis=1) >= 0.0).all()
    np.testing.assert_allclose(forecast.p_gap.sum(axis=1), forecast.p_within[:, -1])
    assert forecast.p_gap.shape == (64, len(GAPS))
    assert abs(forecast.chance.sum(axis=1).mean() - forecast.p_within[:, -1].mean()) < 0.04


def test_median_time_and_place_belong_to_the_samples(forecast):
    never = forecast.p_within[:, -1] < 0.5
    assert (forecast.median_time[never] == 15.0).all()
    assert (forecast.median_time[~never] < 15.0).all()
    place = forecast.merge_place
    np.testing.assert_array_equal(np.isnan(place), forecast.p_within[:, -1] == 0.0)
    assert (place[~np.isnan(place)] >= 0.0).all()


def test_samples_are_physical_after_the_correction_too(model, test, forecast):
    led, followed = (np.isfinite(place) for place in (forecast.leader_rear, forecast.follower_front))
    assert (forecast.samples <= forecast.leader_rear + 1e-3)[led].all()
    assert (forecast.follower_front <= forecast.samples - LENGTH + 1e-3)[followed].all()
    assert led.any()
    assert followed.any()
    speed = np.diff(forecast.samples, axis=2, prepend=0.0) / STEP
    assert speed.min() >= -1e-3
    assert speed.max() <= max(model.merges.roll_out.roll_out.limit, 14.0) + 1e-2
    assert (np.diff(forecast.quantiles, axis=2) >= -1e-6).all()
    assert (np.diff(forecast.median, axis=1) >= -1e-6).all()


def test_merges_are_forecast_as_often_as_they_happen(forecast, test):
    for second in (2, 5, 10):
        happened = (np.nan_to_num(test.change_time, nan=99.0) <= second).mean()
        assert abs(forecast.p_within[:, 5 * second - 1].mean() - happened) < 0.15


def test_places_are_forecast_well_and_covered(forecast, test):
    error = np.abs(forecast.median - test.truth)[:, 24]
    assert error.mean() < 4.0  # of 55 m in 5 s: those that merge may brake in the forecast, and do not in truth
    low, high = np.moveaxis(forecast.quantiles_at(0.05, 0.95)[:, 24], -1, 0)
    assert ((test.truth[:, 24] >= low) & (test.truth[:, 24] <= high)).mean() > 0.7


def test_a_scene_alone_is_forecast_as_in_company(model, test, forecast):
    for row in (0, 31):
        one = model.predict(test.scenes.select(np.array([row])))
        np.testing.assert_allclose(one.samples[0], forecast.samples[row], atol=2e-2)
        np.testing.assert_array_equal(one.merge_step[0], forecast.merge_step[row])


def test_without_a_lane_to_merge_into_nobody_merges(model, test, forecast):
    some = without_target(test.scenes.own.select(np.arange(8)))
    found = model.predict(some)
    assert (found.merge_step == FUTURE).all()
    assert (found.p_within == 0.0).all()
    assert np.isnan(found.follower_front).all()
    assert np.isnan(found.merge_place).all()


def test_without_a_merge_in_training_all_are_forecast_as_platoons(model, test):
    found = replace(model, merges=None).predict(test.scenes.select(np.arange(8)))
    assert (found.merge_step == FUTURE).all()


def test_quantiles_are_those_of_numpy_over_all_samples_or_over_those_that_wait(test):
    """Nothing is known of where vehicles go that nobody has seen after their merge: then those that wait count."""
    rng = np.random.default_rng(1)
    x = np.cumsum(rng.uniform(0.0, 3.0, (5, 30, FUTURE)), axis=2).astype(np.float32)
    step = rng.integers(0, 60, (5, 30))
    drawn = MergeSamples(x, x, x, step, np.zeros_like(step), np.zeros((5, FUTURE)))
    levels = np.array([0.1, 0.5, 0.77])
    expected = np.moveaxis(np.quantile(x, levels, axis=1), 0, -1)
    np.testing.assert_allclose(sample_quantiles(drawn, levels, beyond=True), expected, rtol=1e-5)
    found = sample_quantiles(drawn, levels, beyond=False)
    np.testing.assert_allclose(found[2, 20], np.quantile(x[2, step[2] >= 20, 20], levels), rtol=1e-5)
    np.testing.assert_allclose(found[:, 74], expected[:, 74], rtol=1e-5)  # all have merged: they all count
