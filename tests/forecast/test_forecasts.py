"""Forecasts of many moments: reduced, joined, chosen from, and told in tables."""

import numpy as np
import polars as pl
import pytest

from rampcast.forecast.forecasts import joined
from rampcast.forecast.protocol import RecordingForecast
from rampcast.forecast.tables import BANDS, FILES
from rampcast.horizon import FUTURE
from tests.forecast.forecasts_made_up import RAMP, TARGET, driving, random_forecast
from tests.forecast.test_forecast import nobody

KEYS = ["recording", "vehicle", "t0"]


@pytest.fixture(scope="module")
def forecast():
    return random_forecast(1)


def test_reduced_forecasts_are_forecasts_of_a_recording(forecast):
    found = forecast.reduced(recording="noon")
    assert isinstance(found, RecordingForecast)
    assert repr(found) == "<Forecasts of noon: 12 vehicles at a moment>"
    assert "<td>12.0 to 12.0 s</td>" in found._repr_html_()
    np.testing.assert_array_equal(found.vehicle, forecast.vehicle)
    np.testing.assert_allclose(found.x["rampcast"], forecast.median, atol=1e-4)
    np.testing.assert_allclose(found.bands["rampcast"], forecast.quantiles(tuple(BANDS.values())), atol=1e-4)


def test_there_is_a_row_for_every_vehicle_and_step_with_its_lane(forecast):
    table = forecast.tables()["forecast"]
    assert table.columns == [*KEYS, "lane", "horizon", "x", "model", *BANDS]
    assert table.height == len(forecast) * FUTURE
    own = table.filter(vehicle=int(forecast.vehicle[4]))
    np.testing.assert_allclose(own["horizon"], 0.2 * np.arange(1, 76), atol=1e-9)
    np.testing.assert_allclose(own["x"], forecast.median[4], atol=0.00501)
    assert own["lane"].unique().to_list() == [forecast.start_lane[4]]
    assert set(table["lane"]) == {RAMP, TARGET}


def test_positions_are_told_to_a_centimetre_and_probabilities_to_four_decimals(forecast):
    tables = forecast.tables()
    for column in ("x", *BANDS):
        values = tables["forecast"][column]
        assert values.dtype == pl.Float32
        np.testing.assert_allclose(values * 100, (values * 100).round(), atol=1e-2)
    assert len(tables["forecast"].head(1).write_csv(include_header=False).split(",")[5]) <= len("123.45")
    shares = tables["conflicts"]["probability"].cast(pl.Float64)
    assert tables["conflicts"]["probability"].dtype == pl.Float32
    np.testing.assert_allclose(shares * 1e4, (shares * 1e4).round(), atol=1e-2)


def test_within_is_by_the_end_of_a_second_and_at_is_in_its_last_step():
    """It merges in the step that ends at 3 s."""
    forecast = driving(start=[50.0, 0.0], lane=[RAMP, TARGET], speed=[10.0, 10.0], merge=[3.0, None])
    table = forecast.tables()["lane_change"]
    assert table.columns == [*KEYS, "t", "p_within", "p_at", "model"]
    assert table["vehicle"].to_list() == [101] * 16  # of those on the ramp
    np.testing.assert_array_equal(table["p_within"], np.arange(16) >= 3)
    np.testing.assert_array_equal(table["p_at"], np.arange(16) == 3)


def test_the_gap_table_has_the_ids_and_adds_up_to_the_merges(forecast):
    tables = forecast.tables()
    assert tables["gap"].columns == [*KEYS, "gap", "ahead", "behind", "p"]
    merged = tables["lane_change"].filter(t=15.0).select(*KEYS, "p_within")
    both = merged.join(tables["gap"].group_by(KEYS).agg(p=pl.col("p").sum()), on=KEYS, how="left")
    np.testing.assert_allclose(both["p"].fill_null(0.0), both["p_within"], atol=1e-3)
    assert set(tables["gap"]["ahead"].drop_nulls()) <= set(forecast.vehicle.tolist())


def test_conflicts_have_a_row_for_each_measure_and_second(forecast):
    table, found = forecast.tables()["conflicts"], forecast.conflicts
    assert table.columns == [*KEYS, "measure", "t", "probability"]
    assert table.height == 31 * len(forecast)
    own = table.filter(vehicle=int(forecast.vehicle[2]))
    np.testing.assert_allclose(
        own.filter(measure="ttc", t=4.0)["probability"], found.time_to_collision[2, 19], atol=1e-4
    )
    np.testing.assert_allclose(own.filter(measure="drac", t=15.0)["probability"], found.deceleration[2, 74], atol=1e-4)
    np.testing.assert_allclose(own.filter(measure="pet")["probability"], found.encroachment[2], atol=1e-4)


def test_chosen_and_joined_forecasts_are_those_of_their_scenes():
    moments = [random_forecast(seed).reduced(recording=f"day {seed}") for seed in (1, 2, 3)]
    together = joined(moments)
    assert len(together) == 36
    some = together.select(np.array([30, 2, 14]))
    assert some.recording.tolist() == ["day 3", "day 1", "day 2"]
    for name, table in some.tables().items():
        parts = [moments[2].select(np.array([6])), moments[0].select(np.array([2])), moments[1].select(np.array([2]))]
        assert table.equals(pl.concat([part.tables()[name] for part in parts])), name


def test_of_all_vehicles_those_that_are_asked_for_are_kept(forecast):
    rows = np.array([5, 1])
    some = forecast.reduced(rows, recording="noon")
    for name, table in some.tables().items():
        assert table.sort(table.columns).equals(
            forecast.reduced(recording="noon").select(rows).tables()[name].sort(table.columns)
        ), name


def test_of_nobody_there_are_tables_without_rows():
    empty = nobody().reduced(recording="noon")
    assert set(empty.tables()) == set(FILES)
    full = random_forecast(1).reduced(recording="noon")
    for name, table in empty.tables().items():
        assert table.schema == full.tables()[name].schema
        assert table.height == 0
    assert joined([empty, full, empty]).position_table().equals(full.position_table())
    assert len(joined([empty])) == 0
    assert repr(joined([empty])) == "<Forecasts of no window: 0 vehicles at a moment>"
