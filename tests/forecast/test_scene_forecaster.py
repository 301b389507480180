"""The forecaster of merge scenes: its contracts, what its samples say of merges, and scenes without a lane to merge."""

import numpy as np
import pytest

from rampcast.forecast.calibrated import FEWEST_UNMERGED, CalibratedSpec, counted_quantiles, unmerged
from rampcast.forecast.scene_forecaster import GAPS, fit_scene_forecaster
from rampcast.horizon import FUTURE, STEP
from rampcast.models.correction import CorrectionSpec
from rampcast.traffic.merge_scenes import without_target
from rampcast.traffic.situation import situation_of_scenes
from tests.forecast.merges_made_up import LENGTH, merges

pytestmark = pytest.mark.slow

SPEC = CalibratedSpec(samples=20, folds=3, correction=CorrectionSpec(trees=10))


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
    assert speed.max() <= max(model.model.base.roll_out.limit, 14.0) + 1e-2
    quantiles = forecast.quantiles_at(*np.linspace(0.01, 0.99, 21))
    assert (np.diff(quantiles, axis=2) >= 0.0).all()
    assert (np.diff(quantiles, axis=1) >= 0.0).all()


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


def test_quantiles_are_those_of_numpy_over_the_samples_that_count():
    rng = np.random.default_rng(1)
    x = np.cumsum(rng.uniform(0.0, 3.0, (5, 30, 8)), axis=2).astype(np.float32)
    counts = rng.random(x.shape) < 0.5
    found = np.stack(counted_quantiles(x, counts, (0.02, 0.1, 0.5, 0.77)), axis=-1)
    for row, knot in np.ndindex(5, 8):
        some = x[row, counts[row, :, knot], knot].astype(float)
        expected = np.quantile(some, (0.02, 0.1, 0.5, 0.77), method="weibull")
        np.testing.assert_allclose(found[row, knot], expected)


def test_where_vehicles_were_not_seen_after_their_merge_those_that_wait_count(test):
    """Of too few that wait no quantile is taken: then all count."""
    situation = situation_of_scenes(test.scenes.select(np.arange(3)))
    lane = np.zeros((3, 30, 2), dtype=np.int16)
    lane[0, :20, 1] = lane[1, : 30 - FEWEST_UNMERGED + 1, 1] = 1
    counts = unmerged(situation, situation.first[:-1], lane)
    assert counts[:, :, 0].all()
    np.testing.assert_array_equal(counts[0, :, 1], lane[0, :, 1] == 0)
    assert counts[1:, :, 1].all()
