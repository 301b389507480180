"""Forecasts beside what came: second by second, between frames too, and never where nothing was seen."""

import numpy as np
import polars as pl
import pytest

from rampcast.evaluate.positions import beside_truth, errors_by
from tests.made_up_traffic import random_traffic


@pytest.fixture(scope="module")
def recording():
    return random_traffic(3, vehicles=6, seconds=24.0, name="i80-1")


def forecasts_of(recording, *, off, shift=0.0):
    """Returns forecasts at 2 s and 5 s of each vehicle's first moment, `off` m from a straight line through frames."""
    step = recording.time_step
    rows = recording.tracks.group_by("vehicle", maintain_order=True).first().select("vehicle", "frame")
    table = rows.join(pl.DataFrame({"horizon": [2.0, 5.0, 0.4]}), how="cross")
    return table.select(
        "vehicle", "horizon", recording=pl.lit("i80-1"), t0=pl.col("frame") * step + shift, x=pl.lit(off),
        model=pl.lit("rampcast"), **dict.fromkeys(("x_q05", "x_q25", "x_q50", "x_q75", "x_q95"), pl.lit(off)),
    )  # fmt: skip


def test_between_two_frames_the_truth_is_in_between(recording):
    step = recording.time_step
    at, later = (
        beside_truth(forecasts_of(recording, off=0.0, shift=shift).lazy(), recording)
        .collect()
        .sort("vehicle", "horizon")
        for shift in (0.0, step / 4)
    )
    tracks = recording.tracks
    for one, other in zip(at.iter_rows(named=True), later.iter_rows(named=True), strict=True):
        mine = tracks.filter(pl.col("vehicle") == one["vehicle"]).sort("frame")
        x = np.interp(other["t0"] + other["horizon"], mine["frame"].to_numpy() * step, mine["x"].to_numpy())
        assert other["truth"] == pytest.approx(x, abs=1e-3)
    assert set(at["horizon"]) == {2.0, 5.0}  # whole seconds alone


def test_what_was_not_seen_is_no_error(recording):
    late = forecasts_of(recording, off=0.0, shift=1000.0)
    assert beside_truth(late.lazy(), recording).collect().is_empty()


def test_bands_of_no_width_that_are_wrong_hold_nothing_and_cost_the_error(recording):
    table = beside_truth(forecasts_of(recording, off=-10.0).lazy(), recording)
    found = errors_by(table, ["horizon"])
    assert (found["inside_90"] == 0.0).all()
    np.testing.assert_allclose(found["crps"], found["mean_error"], rtol=1e-6)  # the mean of both pinball losses is half
    np.testing.assert_allclose(found["bias"], -found["mean_error"], rtol=1e-9)
    assert (found["width_90"] == 0.0).all()


def test_of_forecasts_without_bands_nothing_is_said_of_bands(recording):
    bare = forecasts_of(recording, off=0.0).with_columns(
        pl.lit(None, pl.Float64).alias(f"x_q{q}") for q in ("05", "25", "50", "75", "95")
    )
    found = errors_by(beside_truth(bare.lazy(), recording), ["horizon"])
    assert found["crps"].null_count() == found["inside_90"].null_count() == found.height
    assert found["mean_error"].null_count() == 0
