"""Errors of position forecasts, second by second, as a tidy table."""

import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from rampcast.horizon import STEPS_PER_SECOND

NEAR, FAR = 5.0, 10.0  # [m] the paper counts forecasts within these
SCORES = ("within_5", "within_10", "mean_error", "bias")


def position_errors(
    predicted: Float[np.ndarray, "forecast future"],
    observed: Float[np.ndarray, "forecast future"],
    valid: Bool[np.ndarray, "forecast future"],
) -> pl.DataFrame:
    """Returns, for each whole second ahead, how far the forecasts lie from what was seen.

    Columns: horizon [s], n (forecasts whose truth was seen), within_5, within_10 (shares), mean_error (mean absolute
    error [m]), bias (mean of forecast minus observed [m]). Where n is 0 the others are null.

    Args:
        predicted: x [m] at steps of 0.2 s after t = 0.
        observed: the truth [m]; not read where `valid` is False.
        valid: whether the truth was seen.
    """
    rows = []
    for step in range(STEPS_PER_SECOND - 1, predicted.shape[1], STEPS_PER_SECOND):
        error = (predicted[:, step] - observed[:, step])[valid[:, step]]
        about = position_scores(error) if len(error) else dict.fromkeys(SCORES)
        rows.append({"horizon": float((step + 1) // STEPS_PER_SECOND), "n": len(error)} | about)
    schema = {"horizon": pl.Float64, "n": pl.Int64} | dict.fromkeys(SCORES, pl.Float64)
    return pl.DataFrame(rows, schema=schema)


def position_scores(error: Float[np.ndarray, "forecast"]) -> dict[str, float]:
    """Returns the `SCORES` of forecast minus observed [m], one at least; for what they are see `position_errors`."""
    size = np.abs(error)
    values = (np.mean(size < NEAR), np.mean(size < FAR), size.mean(), error.mean())
    return dict(zip(SCORES, map(float, values), strict=True))
