"""Errors of position forecasts, second by second, as a tidy table: the one place where forecasts meet the truth."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from rampcast.horizon import FUTURE, STEPS_PER_SECOND
from rampcast.recording import Recording
from rampcast.recording import columns as c

NEAR, FAR = 5.0, 10.0  # [m] the paper counts forecasts within these
ERROR: Final = pl.col("error")
SCORES: Final = {
    "within_5": (ERROR.abs() < NEAR).mean(),
    "within_10": (ERROR.abs() < FAR).mean(),
    "mean_error": ERROR.abs().mean(),
    "bias": ERROR.mean(),
}
LEVELS: Final = {"x_q05": 0.05, "x_q25": 0.25, "x_q50": 0.5, "x_q75": 0.75, "x_q95": 0.95}
TRUTH: Final = pl.col("truth")
PINBALL: Final = [
    (TRUTH - pl.col(name)) * (level - (TRUTH < pl.col(name)).cast(pl.Float64)) for name, level in LEVELS.items()
]
BAND_SCORES: Final = {
    "crps": (2.0 * pl.mean_horizontal(*PINBALL, ignore_nulls=False)).mean(),
    "inside_50": TRUTH.is_between("x_q25", "x_q75").mean(),
    "inside_90": TRUTH.is_between("x_q05", "x_q95").mean(),
    "width_90": (pl.col("x_q95") - pl.col("x_q05")).cast(pl.Float64).mean(),
}
WHOLE: Final = (pl.col("horizon") - pl.col("horizon").round()).abs() < 0.01  # a horizon in whole seconds
ON_FRAME: Final = 1e-3  # of the time between two frames: a moment this close to one is there


def beside_truth(forecasts: pl.LazyFrame, recording: Recording) -> pl.LazyFrame:
    """Returns forecasts at whole seconds beside what came; those whose truth was not seen are left out.

    Columns beside those of the forecasts: truth, error (forecast minus truth) [m], lane_then. Between two frames the
    truth is in between.

    Args:
        forecasts: a table of positions; see docs/forecast_files.md.
        recording: raw or smoothed; what came is taken from the raw one.
    """
    raw = recording.raw if recording.raw is not None else recording
    frames = (pl.col("t0") + pl.col("horizon")) / raw.time_step
    whole = forecasts.filter(WHOLE).with_columns(pl.col("recording").cast(pl.String), frames.alias("moment"))
    before = (pl.col("moment") + ON_FRAME).floor()
    asked = whole.with_columns(frame=before.cast(pl.Int64), part=(pl.col("moment") - before).clip(0.0, 1.0))
    vehicle = pl.col(c.VEHICLE).cast(forecasts.collect_schema()["vehicle"])
    seen = raw.tracks.lazy().select(
        pl.col(c.RECORDING).cast(pl.String), vehicle, pl.col(c.FRAME).cast(pl.Int64),
        truth=pl.col(c.X).cast(pl.Float64), lane_then=c.LANE,
    )  # fmt: skip
    later = seen.select(c.RECORDING, c.VEHICLE, pl.col(c.FRAME) - 1, truth_after="truth")
    key = [c.RECORDING, c.VEHICLE, c.FRAME]
    found = asked.join(seen, on=key).join(later, on=key, how="left")
    between = TRUTH + pl.col("part") * (pl.col("truth_after") - TRUTH)
    found = found.with_columns(truth=pl.when(pl.col("part") > ON_FRAME).then(between).otherwise(TRUTH))
    found = found.filter(TRUTH.is_not_null()).drop("moment", "part", "truth_after", c.FRAME)
    return found.with_columns(error=pl.col("x").cast(pl.Float64) - TRUTH)


def errors_by(table: pl.LazyFrame, by: Sequence[str]) -> pl.DataFrame:
    """Returns how far off forecasts are and how often their bands hold, for each group, sorted.

    Columns beside those of the groups: n, within_5, within_10 (shares), mean_error (mean absolute error [m]), bias
    (mean of forecast minus truth [m]); crps [m], inside_50, inside_90 (shares of truths in those bands), width_90 [m];
    null of forecasts without bands. The crps is twice the mean pinball loss of five quantiles: a little coarser than
    that of all samples.

    Args:
        table: as `beside_truth` gives it.
        by: columns that name a group, "horizon" among them.
    """
    wanted = table.select([*dict.fromkeys([*by, "horizon", "error", "truth", *LEVELS])])
    seconds = pl.col("horizon").round()  # one after the other: the rows of all would fill the memory
    found = [_errors_by(wanted.filter(seconds == second), by) for second in range(1, FUTURE // STEPS_PER_SECOND + 1)]
    return pl.concat(found).sort(by)


def _errors_by(table: pl.LazyFrame, by: Sequence[str]) -> pl.DataFrame:
    measured = {"n": pl.len(), **SCORES, **BAND_SCORES}
    # a sum of floats depends on their order, which threads change: sorted rows give the same to the bit on any machine
    rows = table.select(*by, "error", "truth", *LEVELS).collect().sort(pl.all())
    groups = rows.partition_by(by, maintain_order=True) or [rows]
    found = [group.select(*(pl.col(name).head(1) for name in by), **measured) for group in groups if group.height]
    return pl.concat(found) if found else rows.group_by(by).agg(**measured)


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
        about = position_scores(error)
        rows.append({"horizon": float((step + 1) // STEPS_PER_SECOND), "n": len(error), **about})
    schema = {"horizon": pl.Float64, "n": pl.Int64} | dict.fromkeys(SCORES, pl.Float64)
    return pl.DataFrame(rows, schema=schema)


def position_scores(error: Float[np.ndarray, "forecast"]) -> dict[str, float | None]:
    """Returns the `SCORES` of forecast minus observed [m], None of none; for what they are see `position_errors`."""
    return pl.DataFrame({"error": error.astype(np.float64)}).select(**SCORES).row(0, named=True)
