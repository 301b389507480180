"""How far off the forecasts of a recording were, second by second, once the truth is in the recording."""

import polars as pl

from rampcast.evaluate.positions import FAR, NEAR
from rampcast.recording import Recording
from rampcast.recording import columns as c


def scores_of(forecasts: pl.LazyFrame, recording: Recording) -> pl.DataFrame:
    """Returns errors of forecasts against the recording that they were made from.

    Columns: model, horizon [s], n (forecasts whose truth was seen), mean_error, bias (mean of forecast minus truth)
    [m], within_5, within_10 (shares of errors below 5 and 10 m), in_band (share of truths in the band of 90 %).

    Args:
        forecasts: a table of positions; see docs/forecast_files.md.
        recording: raw or smoothed.
    """
    raw = recording.raw if recording.raw is not None else recording
    frame = ((pl.col("t0") + pl.col("horizon")) / raw.time_step).round().cast(pl.Int64)
    truth = raw.tracks.lazy().select(
        pl.col(c.RECORDING).cast(pl.String), c.VEHICLE, pl.col(c.FRAME).cast(pl.Int64), pl.col(c.X).alias("truth")
    )
    whole = (pl.col("horizon") - pl.col("horizon").round()).abs() < 0.01
    error = pl.col("x").cast(pl.Float64) - pl.col("truth")
    return (
        forecasts.filter(whole)
        .with_columns(frame.alias(c.FRAME), pl.col("recording").cast(pl.String))
        .join(truth, on=[c.RECORDING, c.VEHICLE, c.FRAME], how="inner")
        .group_by("model", "horizon")
        .agg(
            pl.len().alias("n"),
            error.abs().mean().alias("mean_error"),
            error.mean().alias("bias"),
            (error.abs() < NEAR).mean().alias("within_5"),
            (error.abs() < FAR).mean().alias("within_10"),
            pl.col("truth").is_between("x_q05", "x_q95").mean().alias("in_band"),
        )
        .sort("model", "horizon")
        .collect()
    )
