"""The tables that forecasts are written as, whoever made them; docs/forecast_files.md says what is in them."""

from typing import Final

import numpy as np
import polars as pl

from rampcast.forecast.protocol import RecordingForecast
from rampcast.horizon import FUTURE, STEP

FILES: Final = ("forecast", "lane_change", "gap", "conflicts")  # that a forecast may be written as
BANDS: Final = {"x_q05": 0.05, "x_q25": 0.25, "x_q50": 0.5, "x_q75": 0.75, "x_q95": 0.95}  # column, level
TIMES: Final = tuple(range(round(FUTURE * STEP) + 1))  # [s] of the probabilities of lane changes


def position_table(forecast: RecordingForecast) -> pl.DataFrame:
    """Returns the columns recording, vehicle, t0 [s], horizon [s], x [m], model, and quantiles of x [m].

    The quantiles are null for models that give none.
    """
    tables = []
    for name, x in forecast.x.items():
        steps = x.shape[1]
        horizon = np.round(np.arange(1, steps + 1) * STEP, 1)
        bands = forecast.bands.get(name)
        tables.append(
            keys(forecast, steps).with_columns(
                horizon=pl.Series(np.tile(horizon, len(x))),
                x=pl.Series(x.ravel()),
                model=pl.lit(name),
                **{
                    column: pl.lit(None, pl.Float64) if bands is None else pl.Series(bands[..., number].ravel())
                    for number, column in enumerate(BANDS)
                },
            )
        )
    return pl.concat(tables)


def lane_change_table(forecast: RecordingForecast) -> pl.DataFrame:
    """Returns the columns recording, vehicle, t0 [s], t [s], p_within, p_at, model."""
    time = pl.Series(np.tile(np.array(TIMES, dtype=float), len(forecast.t0)))
    tables = [
        keys(forecast, len(TIMES)).with_columns(
            t=time, p_within=pl.Series(within.ravel()), p_at=pl.Series(at.ravel()), model=pl.lit(name)
        )
        for name, (within, at) in forecast.lane_changes.items()
    ]
    return pl.concat(tables)


def keys(forecast: RecordingForecast, repeats: int) -> pl.DataFrame:
    """Returns the columns recording, vehicle, t0 [s], each scene so many times."""
    return pl.DataFrame(
        {
            "recording": pl.Series(np.repeat(forecast.recording, repeats), dtype=pl.String),
            "vehicle": np.repeat(forecast.vehicle, repeats),
            "t0": np.round(np.repeat(forecast.t0, repeats), 1),
        }
    )
