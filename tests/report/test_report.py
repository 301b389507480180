"""The report of a forecast: numbers worked out by hand, a page that names all its parts, slides of the right size."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from matplotlib.image import imread

from rampcast.errors import RampcastError
from rampcast.recording import Recording, read_recording
from rampcast.report import SLIDES, About, report_on, write_picture
from rampcast.report.measures import errors, merges, with_truth
from rampcast.simulate import shipped_sample

SPREAD = {"x_q05": -4.0, "x_q25": -1.0, "x_q50": 0.0, "x_q75": 1.0, "x_q95": 4.0}


@pytest.fixture(scope="module")
def recording() -> Recording:
    whole = read_recording(shipped_sample()[1])
    return replace(whole, tracks=whole.tracks.filter(pl.col("frame") < 900))


def forecast_of(recording: Recording, off: float) -> pl.DataFrame:
    """Returns a forecast of what came, `off` m too far."""
    rows = recording.tracks.select(pl.col("recording").cast(pl.String), "vehicle", "frame", "lane", "x")
    now = rows.filter(pl.col("frame") % 100 == 0)
    ahead = now.join(pl.DataFrame({"horizon": np.arange(1.0, 16.0)}), how="cross")
    ahead = ahead.with_columns(frame_then=(pl.col("frame") + pl.col("horizon") * 10).cast(pl.Int32))
    came = rows.select("recording", "vehicle", frame_then="frame", came="x")
    ahead = ahead.join(came, on=["recording", "vehicle", "frame_then"]).with_columns(x=pl.col("came") + off)
    bands = [(pl.col("x") + wide).alias(name) for name, wide in SPREAD.items()]
    named = ahead.with_columns(*bands, t0=pl.col("frame") * 0.1, model=pl.lit("rampcast"))
    return named.select("recording", "vehicle", "t0", "lane", "horizon", "x", "model", *SPREAD)


def test_errors_are_what_was_put_in(recording):
    table = errors(with_truth(forecast_of(recording, 2.0), recording)).filter(situation="all")
    assert table["horizon"].to_list() == list(range(1, 16))
    np.testing.assert_allclose(table["mean_error"], 2.0, atol=1e-4)
    np.testing.assert_allclose(table["width_90"], 8.0, atol=1e-4)
    assert (table["inside_90"] == 1.0).all()
    assert (table["inside_50"] == 0.0).all()
    # 2 m below the middle: pinball losses 0.05 x 2, 0.75 x 1, 0.5 x 2, 0.25 x 3, 0.05 x 6, twice their mean
    np.testing.assert_allclose(table["crps"], 2 * (0.1 + 0.75 + 1.0 + 0.75 + 0.3) / 5, atol=1e-4)


def test_situations_are_told_without_what_came(recording):
    table = with_truth(forecast_of(recording, 0.0), recording)
    assert table.group_by("recording", "vehicle", "t0").agg(pl.col("situation").n_unique())["situation"].max() == 1


def test_merges_are_the_changes_out_of_the_ramp(recording):
    table = merges(recording)
    assert table.height == table.select("recording", "vehicle").n_unique() > 2
    assert table["x"].is_between(recording.site.gore - 20, recording.site.ramp_end + 20).all()
    assert (table["gap_ahead"].drop_nulls() > 0).all()


@pytest.mark.slow
def test_the_page_has_its_parts_and_slides_are_for_a_screen(recording, tmp_path):
    forecast = forecast_of(recording, 1.0)
    forecast.write_parquet(tmp_path / "forecast.parquet")
    chances = forecast.filter(pl.col("lane").is_in(list(recording.site.ramp_lanes)))
    chances = chances.select("recording", "vehicle", "t0", t="horizon", p_within=pl.col("horizon") / 15)
    chances.write_parquet(tmp_path / "lane_change.parquet")
    page = report_on([recording], tmp_path, About("made up", False, "1", {"Other": "x/y.html"}))
    text = page.read_text(encoding="utf-8")
    for head in ("What was recorded", "A typical forecast", "Merging", "How far to trust it", "did it come?", "limits"):
        assert head in text
    assert '<a href="x/y.html">Other</a>' in text
    assert "rampcast train" in text
    for slide in SLIDES:
        assert imread(tmp_path / slide).shape[:2] == (1080, 1920)
    assert pl.read_csv(tmp_path / "errors.csv").height > 15


def test_a_picture_is_drawn_from_files_and_what_is_not_there_is_told(recording, tmp_path):
    forecast_of(recording, 1.0).write_parquet(tmp_path / "forecast.parquet")
    write_picture("fan", tmp_path / "forecast.parquet", recording, tmp_path / "fan.png", vehicle="213", t0=None)
    assert imread(tmp_path / "fan.png").shape[:2] == (1080, 1920)
    with pytest.raises(RampcastError, match="no forecast of vehicle 0 at"):
        write_picture("fan", tmp_path / "forecast.parquet", recording, tmp_path / "x.png", vehicle="0", t0=None)
    with pytest.raises(RampcastError, match="there is no such file"):
        write_picture("trust", tmp_path / "x.parquet", recording, tmp_path / "x.png", vehicle=None, t0=None)
