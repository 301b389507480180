"""What the forecaster of platoons must hold to: its contracts, its physics and its calibration."""

from dataclasses import replace

import numpy as np
import pytest

from rampcast.forecast.platoon_forecaster import PlatoonForecasterSpec, fit_platoon_forecaster
from rampcast.forecast.platoon_roll_out import sample_platoons
from rampcast.models.correction import CorrectionSpec
from rampcast.models.pooled_driver import fit_pooled_driver, roll_chain
from rampcast.traffic.platoons import known_lengths
from tests.models.platoons_made_up import drive

pytestmark = pytest.mark.slow

SPEC = PlatoonForecasterSpec(samples=40, folds=3, correction=CorrectionSpec(trees=20))


@pytest.fixture(scope="module")
def train():
    return drive(240, seed=1, scatter=0.2, noise=0.4)


@pytest.fixture(scope="module")
def test():
    return drive(240, seed=2, scatter=0.2, noise=0.4)


def fitted(made, *, seed=1, spec=SPEC):
    return fit_platoon_forecaster(
        made.platoons, made.truth, made.leader_truth, group=made.group, t0=made.t0, seed=seed, spec=spec
    )


@pytest.fixture(scope="module")
def model(train):
    return fitted(train)


@pytest.fixture(scope="module")
def forecast(model, test):
    return model.predict(test.platoons)


@pytest.fixture(scope="module")
def alone(model):
    """The roll-outs without correction."""
    return replace(model, correction=None)


def test_a_seed_gives_the_same_forecast_again_and_another_seed_another(train, model, test, forecast):
    some = test.platoons.select(np.arange(5))
    again = fitted(train).predict(some)
    np.testing.assert_array_equal(again.samples, forecast.samples[:5])
    assert np.abs(replace(model, seed=2).predict(some).samples - forecast.samples[:5]).max() > 0.1


def test_a_platoon_alone_is_forecast_as_in_company(model, test, forecast):
    for row in (0, 7, 239):
        one = model.predict(test.platoons.select(np.array([row])))
        np.testing.assert_allclose(one.samples[0], forecast.samples[row], atol=1e-3)
        np.testing.assert_allclose(one.quantiles[0], forecast.quantiles[row], atol=1e-3)


def test_moving_all_places_changes_no_displacement(model, test, forecast):
    moved = replace(test.platoons, x=test.platoons.x + 512.0)
    np.testing.assert_allclose(model.predict(moved).quantiles, forecast.quantiles, atol=0.05)


def test_what_lies_in_an_empty_place_changes_nothing(model, test, forecast):
    platoons = test.platoons
    noise = np.random.default_rng(2).normal(50.0, 20.0, platoons.x.shape)
    x, v, a = (np.where(platoons.valid, values, noise) for values in (platoons.x, platoons.v, platoons.a))
    changed = replace(platoons, x=x, v=v, a=a, length=np.where(platoons.present, platoons.length, 77.0))
    found = model.predict(changed)
    np.testing.assert_array_equal(found.samples, forecast.samples)
    np.testing.assert_array_equal(found.quantiles, forecast.quantiles)


@pytest.mark.parametrize("name", ["model", "alone"])
def test_no_sample_reverses_overlaps_its_leader_or_exceeds_the_limit(name, request, test):
    model = request.getfixturevalue(name)
    found = model.predict(test.platoons)
    x = np.concatenate([np.zeros_like(found.samples[:, :, :1]), found.samples], axis=2)
    moved = np.diff(x.astype(float), axis=2)
    assert moved.min() >= -1e-3
    assert moved.max() <= model.roll_out.limit * 0.2 + 1e-3
    gap = found.leader_samples - found.samples - known_lengths(test.platoons)[:, 1, None, None]
    assert np.nanmin(gap) >= -1e-3


def test_vehicles_that_overlap_at_t_0_do_not_reverse_and_do_not_overlap_more(model, test):
    long = test.platoons.length.copy()
    long[:, 1] = 60.0
    found = model.predict(replace(test.platoons, length=long))
    gap_now = test.platoons.x[:, 1, -1] - test.platoons.x[:, 0, -1]
    assert np.diff(found.samples, axis=2).min() >= -1e-3
    assert np.nanmin(found.leader_samples - found.samples - gap_now[:, None, None]) >= -1e-3


@pytest.mark.parametrize("name", ["model", "alone"])
def test_quantiles_rise_with_the_level_and_do_not_fall_with_time(name, request, test):
    quantiles = request.getfixturevalue(name).predict(test.platoons).quantiles
    assert quantiles.shape == (240, 75, 99)
    assert np.diff(quantiles, axis=2).min() >= 0.0
    assert np.diff(quantiles, axis=1).min() >= -1e-3
    assert quantiles.min() >= 0.0


def test_samples_and_quantiles_agree(forecast):
    of_samples = np.moveaxis(np.quantile(forecast.samples[:, :, [24, 74]], (0.25, 0.5, 0.75), axis=1), 0, -1)
    asked = forecast.quantiles_at(0.25, 0.5, 0.75)[:, [24, 74]]
    assert np.abs(of_samples - asked).mean() < 0.1 * (asked[..., 2] - asked[..., 0]).mean()
    np.testing.assert_array_equal(forecast.median, forecast.quantiles_at(0.5)[..., 0])


def test_bands_cover_what_they_promise_on_vehicles_not_trained_on(forecast, test):
    """240 cases: a share of 0.9 is known to 0.02."""
    low, high = np.moveaxis(forecast.quantiles_at(0.05, 0.95), -1, 0)
    inside = ((test.truth >= low) & (test.truth <= high))[:, 4::5].mean(axis=0)
    assert inside.min() > 0.8
    assert 0.85 < inside.mean() < 0.96


def test_the_correction_does_not_harm_and_the_roll_outs_beat_a_pooled_chain(forecast, alone, train, test):
    pooled = fit_pooled_driver(train.platoons, train.truth)
    error = {
        "corrected": np.abs(forecast.median - test.truth)[:, 49].mean(),
        "alone": np.abs(alone.predict(test.platoons).median - test.truth)[:, 49].mean(),
        "pooled": np.abs(roll_chain(pooled, test.platoons, leaders=1) - test.truth)[:, 49].mean(),
    }
    assert error["corrected"] < 1.05 * error["alone"]
    assert error["corrected"] < error["pooled"]


def test_any_depth_is_forecast_and_a_vehicle_without_a_leader_too(model):
    for vehicles in (1, 2, 5, 9):
        found = model.predict(drive(3, seed=5, vehicles=vehicles).platoons)
        assert np.isfinite(found.quantiles).all()
        assert (np.isnan(found.leader_samples) == (vehicles == 1)).all()


def test_too_few_cases_to_correct_leave_the_roll_outs_their_median(test):
    small = drive(30, seed=3)
    model = fitted(small, spec=replace(SPEC, folds=2))
    samples = sample_platoons(model.roll_out, test.platoons, samples=40, seed=1)
    np.testing.assert_allclose(
        model.predict(test.platoons).median[:, 49], np.median(samples.x, axis=1)[:, 49], atol=1e-3
    )


def test_truths_that_end_early_are_enough(train, test):
    short = np.where(np.arange(75) < 30, train.truth, np.nan)
    found = fitted(train._replace(truth=short)).predict(test.platoons)
    assert np.isfinite(found.quantiles).all()


def test_without_noise_samples_differ_by_their_drivers_alone(model, test):
    noisy = model.roll_out
    quiet = replace(noisy, head=replace(noisy.head, noise=0.0), disturbance=replace(noisy.disturbance, size=0.0))
    loud = np.ptp(sample_platoons(noisy, test.platoons, samples=20, seed=1).x[:, :, -1], axis=1)
    still = np.ptp(sample_platoons(quiet, test.platoons, samples=20, seed=1).x[:, :, -1], axis=1)
    assert still.mean() < 0.5 * loud.mean()
