"""The forecast of all vehicles of one moment: what it counts in its samples."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.errors import RampcastError
from rampcast.forecast.tables import BANDS
from rampcast.horizon import FUTURE
from tests.forecast.forecasts_made_up import RAMP, TARGET, TIME, driving, random_forecast

LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)


@pytest.fixture(scope="module")
def forecast():
    return random_forecast(1)


def nobody():
    forecast = random_forecast(1)
    arrays = {name: values[:0] for name, values in vars(forecast).items() if isinstance(values, np.ndarray)}
    return replace(forecast, **arrays)


def test_quantiles_are_those_of_the_sixth_definition_at_any_level(forecast):
    levels = (0.001, 0.05, 0.1, 1 / 3, 0.5, 0.9, 0.999)
    expected = np.quantile(forecast.samples.astype(float), levels, axis=1, method="weibull")
    np.testing.assert_allclose(forecast.quantiles(levels), np.moveaxis(expected, 0, 2), atol=1e-6)


@settings(deadline=None, max_examples=40)
@given(levels=st.lists(st.floats(1e-6, 1 - 1e-6), min_size=2, max_size=8))
def test_quantiles_never_fall_with_the_level(levels):
    found = random_forecast(2, vehicles=3, samples=7, steps=5).quantiles(np.sort(levels))
    assert (np.diff(found, axis=2) >= 0.0).all()


def test_quantiles_come_in_the_order_that_was_asked_for(forecast):
    up, down = forecast.quantiles(LEVELS), forecast.quantiles(LEVELS[::-1])
    np.testing.assert_array_equal(up, down[:, :, ::-1])
    np.testing.assert_array_equal(up[:, :, 2], forecast.median)


@pytest.mark.parametrize("level", [0.0, 1.0, 5.0, float("nan")])
def test_a_level_that_is_no_probability_is_refused(forecast, level):
    with pytest.raises(RampcastError, match="levels: expected probabilities above 0 and below 1, got"):
        forecast.quantiles([0.5, level])


def test_a_band_holds_one_more_sample_as_often_as_it_says():
    """19 samples and a truth of the same law: below the 5 % quantile, the least of them, it is in 1 of 20 cases."""
    drawn = np.random.default_rng(4).normal(size=(20_000, 20, 1)).astype(np.float32)
    some = random_forecast(1, vehicles=20_000, samples=19, steps=1)
    many = replace(some, samples=drawn[:, 1:])
    low, high = np.moveaxis(many.quantiles((0.05, 0.95))[:, 0], 1, 0)
    assert np.mean((drawn[:, 0, 0] > low) & (drawn[:, 0, 0] < high)) == pytest.approx(0.9, abs=0.01)


def test_speeds_are_those_between_the_steps_from_t0_on():
    forecast = driving(start=[50.0, 0.0], lane=[TARGET, TARGET], speed=[12.5, 7.0], merge=[None, None])
    np.testing.assert_allclose(forecast.speeds[:, 0], [[12.5] * FUTURE, [7.0] * FUTURE], atol=1e-3)


def test_a_merge_is_the_first_step_in_the_target_lane_of_who_starts_on_the_ramp():
    forecast = driving(
        start=[50.0, 30.0, 20.0], lane=[RAMP, RAMP, TARGET], speed=[10.0, 10.0, 10.0], merge=[3.0, None, None]
    )
    assert forecast.merge_step.tolist() == [[14], [FUTURE], [FUTURE]]
    np.testing.assert_array_equal(forecast.p_merged[:, 13:15], [[0, 1], [0, 0], [0, 0]])
    np.testing.assert_allclose(forecast.merge_time[:, 0], [2.9, np.inf, np.inf])
    np.testing.assert_allclose(forecast.merge_place[:, 0], [80.0, np.nan, np.nan], atol=1e-4)
    np.testing.assert_allclose(forecast[101].merge_time, [2.9])


def test_who_goes_on_to_another_lane_has_merged_for_good():
    forecast = driving(start=[50.0], lane=[RAMP], speed=[10.0], merge=[3.0])
    forecast.lane[:, :, 30:] = 5
    np.testing.assert_array_equal(forecast.p_merged[0], TIME > 2.9)


def test_the_probability_to_have_merged_is_the_share_of_the_samples(forecast):
    for step in range(FUTURE):
        np.testing.assert_allclose(forecast.p_merged[:, step], (forecast.merge_step <= step).mean(axis=1))
    assert (np.diff(forecast.p_merged, axis=1) >= 0.0).all()
    assert not forecast.p_merged[~forecast.on_ramp].any()


def test_quantiles_of_the_merge_time_are_times_of_samples_and_infinite_beyond_the_forecast(forecast):
    found = forecast.merge_time_quantiles((0.01, 0.25, 0.99))
    assert found.shape == (len(forecast), 3)
    for times, quantiles in zip(forecast.merge_time, found, strict=True):
        assert set(quantiles) <= set(times)
        assert quantiles[0] == times.min()
    assert np.isinf(found[~forecast.on_ramp]).all()
    assert np.isfinite(found[forecast.on_ramp, 0]).any()


def test_the_forecast_of_one_vehicle_is_its_row(forecast):
    one = forecast[int(forecast.vehicle[3])]
    assert one.vehicle == forecast.vehicle[3]
    assert one.start == forecast.start[3]
    np.testing.assert_array_equal(one.samples, forecast.samples[3])
    np.testing.assert_array_equal(one.quantiles(LEVELS), forecast.quantiles(LEVELS)[3])
    for name in ("lane", "speeds", "median", "p_merged", "merge_time", "merge_place"):
        np.testing.assert_array_equal(getattr(one, name), getattr(forecast, name)[3], err_msg=name)
    assert repr(one) == f"<Forecast of vehicle {one.vehicle} of test at 12.0 s>"


def test_a_vehicle_that_is_not_there_is_answered_with_those_that_are():
    forecast = driving(start=[1.0, 2.0], lane=[RAMP, RAMP], speed=[1.0, 1.0], merge=[None, None])
    with pytest.raises(RampcastError, match=r"this forecast has no vehicle 7; it has 2: 101, 102$"):
        forecast[7]
    assert forecast.places(np.array([102, 101])).tolist() == [1, 0]
    with pytest.raises(RampcastError, match="no vehicle 7"):
        forecast.places([102, 7])
    with pytest.raises(RampcastError, match="it has 0: none"):
        nobody()[7]


def test_vehicles_may_be_named_by_texts():
    named = replace(random_forecast(9), vehicle=np.array([f"car {number:02}" for number in range(12)]))
    assert named["car 04"].vehicle == "car 04"
    assert set(named.gap["vehicle"]) <= set(named.vehicle.tolist())


def test_of_nobody_everything_is_empty():
    empty = nobody()
    assert len(empty) == empty.gap.height == 0
    assert empty.quantiles(LEVELS).shape == (0, FUTURE, 5)
    assert empty.merge_time_quantiles(LEVELS).shape == (0, 5)
    assert empty.conflicts.time_to_collision.shape == empty.p_merged.shape == (0, FUTURE)


def test_a_forecast_is_one_line_and_a_table_in_a_notebook():
    forecast = driving(start=[50.0, 0.0], lane=[RAMP, TARGET], speed=[9.0, 9.0], merge=[3.0, None])
    assert repr(forecast) == "<Forecast of test at 12.0 s: 2 vehicles, 1 futures of 15 s>"
    assert "<td>2, 1 of them on the ramp</td>" in forecast._repr_html_()
    assert "likely to merge within 15 s</th><td>101</td>" in forecast._repr_html_()


def test_as_a_table_a_forecast_has_a_row_for_each_vehicle_and_step(forecast):
    table = forecast.to_polars()
    assert table.columns == ["vehicle", "t0", "lane", "horizon", "x", *BANDS, "p_merged"]
    own = table.filter(vehicle=int(forecast.vehicle[4]))
    np.testing.assert_allclose(own["p_merged"], forecast.p_merged[4], atol=1e-4)
    assert forecast.to_pandas()["x"].tolist() == table["x"].to_list()


def test_in_xarray_the_axes_have_names(forecast):
    found = forecast.to_xarray()
    one = found.sel(vehicle=forecast.vehicle[3])
    np.testing.assert_array_equal(one.x.sel(horizon=0.6, method="nearest"), forecast.samples[3, :, 2])
    np.testing.assert_allclose(found.x.median("sample"), np.median(forecast.samples, axis=1))
    assert (found.attrs["site"], found.x.units, found.lane.dtype) == ("test", "m", np.int16)


@pytest.mark.parametrize(("package", "install"), [("xarray", r"rampcast\[xarray\]"), ("pandas", "pip install pandas")])
def test_a_package_that_is_not_there_is_named_with_what_installs_it(forecast, package, install, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(RampcastError, match=f"to_{package} needs {package}.*{install}"):
        getattr(forecast, f"to_{package}")()
