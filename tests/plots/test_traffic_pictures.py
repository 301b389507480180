"""The picture of a forecast of one moment."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from matplotlib.collections import LineCollection

import rampcast as rc
from rampcast.errors import RampcastError
from rampcast.plots.traffic_pictures import traffic_fan
from rampcast.recording import Recording
from tests.factories import TEST_SITE
from tests.forecast.forecasts_made_up import RAMP, TARGET, driving, random_forecast
from tests.made_up_traffic import random_traffic
from tests.plots.looking import assert_readable, legend_labels


@pytest.fixture(scope="module")
def forecast():
    return driving(
        start=[100.0, 140.0, 60.0, 20.0], lane=[RAMP, TARGET, TARGET, RAMP], speed=[12.0, 14.0, 13.0, 8.0],
        merge=[4.0, None, None, None],
    )  # fmt: skip


def test_all_vehicles_are_drawn_by_lane_and_a_likely_merge_is_marked(forecast):
    ax = traffic_fan(forecast.to_polars(), TEST_SITE)
    assert_readable(ax)
    assert legend_labels(ax) == ["lane 6", "lane 7 (ramp)", "as likely merged as not"]
    assert [len(one.get_segments()) for one in ax.collections if isinstance(one, LineCollection)] == [2, 2]
    (merge,) = (line for line in ax.lines if line.get_marker() == "D")
    np.testing.assert_allclose(merge.get_xydata(), [[4.0, 148.0]], atol=1e-2)
    assert any("ramp ends" in text.get_text() for text in ax.texts)


def test_of_chosen_vehicles_the_bands_are_drawn_and_what_came(forecast):
    truth = forecast.to_polars().select("vehicle", "horizon", x_true=pl.col("x") + 1.0).filter(pl.col("horizon") < 9.1)
    ax = traffic_fan(forecast.to_polars().join(truth, on=["vehicle", "horizon"], how="left"), TEST_SITE, vehicles=[102])
    assert_readable(ax)
    labels = ["lane 6", "lane 7 (ramp)", "vehicle 102: median, 50 and 90 %", "vehicle 102: truth"]
    assert legend_labels(ax) == labels
    assert len(ax.collections) == 4  # the others of two lanes, two bands


def test_a_picture_of_nobody_says_so():
    table = random_forecast(1).to_polars().clear()
    assert_readable(traffic_fan(table, TEST_SITE))


def test_the_front_door_draws_the_forecast_with_what_came():
    recording = random_traffic(1)
    site = recording.site
    frames = recording.tracks.filter(pl.col("frame") == 100)
    forecast = replace(
        random_forecast(2, vehicles=frames.height, samples=5), site=site, t0=10.0,
        vehicle=frames["vehicle"].to_numpy(), start_lane=np.full(frames.height, 6),
    )  # fmt: skip
    one = int(forecast.vehicle[0])
    ax = rc.plot(forecast, vehicle=one, truth=recording).axes[0]
    assert ax.get_title(loc="left") == f"{site.title} at 10 s: {frames.height} vehicles"
    assert f"vehicle {one}: truth" in legend_labels(ax)
    (line,) = (line for line in ax.lines if line.get_label() == f"vehicle {one}: truth")
    came = recording.tracks.filter(pl.col("frame") == 102, pl.col("vehicle") == one)
    assert isinstance(recording, Recording)
    np.testing.assert_allclose(line.get_xydata()[0], [0.2, came["x"][0]])
    assert forecast.plot().axes[0].get_title(loc="left") == ax.get_title(loc="left")


def test_a_vehicle_that_is_not_there_is_told(forecast):
    with pytest.raises(RampcastError, match="no vehicle 7; it has 4: 101"):
        rc.plot(forecast, vehicle=[101, 7])
