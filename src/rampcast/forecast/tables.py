"""The tables that forecasts are written as, whoever made them; docs/forecast_files.md says what is in them.

Positions are told to a centimetre and probabilities to four decimals, as numbers of 32 bits: no forecast is as good,
and files are a fraction as large.
"""

from typing import Final, TypeVar

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.forecast.protocol import RecordingForecast
from rampcast.horizon import FUTURE, STEP

FILES: Final = ("forecast", "lane_change", "gap", "conflicts")  # that a forecast may be written as
BANDS: Final = {"x_q05": 0.05, "x_q25": 0.25, "x_q50": 0.5, "x_q75": 0.75, "x_q95": 0.95}  # column, level
TIMES: Final = tuple(range(round(FUTURE * STEP) + 1))  # [s] of the probabilities of lane changes
CENTIMETRES, SHARES, MILLISECONDS = 2, 4, 3  # decimals of positions [m], of probabilities, of moments [s]

Times = TypeVar("Times", float, np.ndarray)


def position_table(forecast: RecordingForecast) -> pl.DataFrame:
    """Returns the columns recording, vehicle, t0 [s], lane, horizon [s], x [m], model, and quantiles of x [m].

    The quantiles are null for models that give none.
    """
    tables = []
    for name, x in forecast.x.items():
        steps = x.shape[1]
        horizon = np.round(np.arange(1, steps + 1) * STEP, 1)
        bands = forecast.bands.get(name)
        tables.append(
            keys(forecast, steps).with_columns(
                lane=pl.Series(np.repeat(forecast.lane, steps), dtype=pl.Int16),
                horizon=pl.Series(np.tile(horizon, len(x))),
                x=_place(x),
                model=pl.lit(name),
                **{
                    column: pl.lit(None, pl.Float32) if bands is None else _place(bands[..., number])
                    for number, column in enumerate(BANDS)
                },
            )
        )
    return pl.concat(tables)


def lane_change_table(forecast: RecordingForecast) -> pl.DataFrame:
    """Returns the columns recording, vehicle, t0 [s], t [s], p_within, p_at, model."""
    time = pl.Series(np.tile(np.array(TIMES, dtype=float), len(forecast.t0)))
    tables = [
        keys(forecast, len(TIMES)).with_columns(t=time, p_within=share(within), p_at=share(at), model=pl.lit(name))
        for name, (within, at) in forecast.lane_changes.items()
    ]
    return pl.concat(tables)


def keys(forecast: RecordingForecast, repeats: int) -> pl.DataFrame:
    """Returns the columns recording, vehicle, t0 [s], each scene so many times."""
    return pl.DataFrame(
        {
            "recording": pl.Series(np.repeat(forecast.recording, repeats), dtype=pl.String),
            "vehicle": np.repeat(forecast.vehicle, repeats),
            "t0": np.repeat(moment(forecast.t0), repeats),
        }
    )


def moment(t0: Times) -> Times:
    """Returns moments as tables tell them [s]."""
    return np.round(t0, MILLISECONDS)


def share(p: Float[np.ndarray, "*shape"]) -> pl.Series:
    """Returns probabilities as tables tell them, one after the other."""
    return _rounded(p, SHARES)


def _place(x: Float[np.ndarray, "*shape"]) -> pl.Series:
    return _rounded(x, CENTIMETRES)


def _rounded(values: Float[np.ndarray, "*shape"], decimals: int) -> pl.Series:
    return pl.Series(np.round(values.ravel().astype(np.float64), decimals).astype(np.float32))
