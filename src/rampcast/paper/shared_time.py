"""Minutes that the training windows share with the test window, told by when their rows were recorded (erratum 8)."""

from dataclasses import replace

import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c


def without_shared_time(training: Recording, test: Recording) -> Recording:
    """Returns the training windows without the rows that were recorded while a window of the test was.

    When a row was recorded is known where the source has a clock, as NGSIM's Global_Time; other windows stay whole.
    """
    spans = (
        _moment(test).drop_nulls().group_by(c.RECORDING).agg(first=pl.col("moment").min(), last=pl.col("moment").max())
    )
    moment = _moment(training)["moment"]
    shared = pl.Series(values=[False] * len(moment), dtype=pl.Boolean)
    for first, last in spans.select("first", "last").iter_rows():
        shared |= moment.is_between(first, last).fill_null(value=False)
    raw = None if training.raw is None else without_shared_time(training.raw, test)
    return replace(training, tracks=training.tracks.filter(~shared), raw=raw)


def _moment(recording: Recording) -> pl.DataFrame:
    """Returns the window of each row, and when it was recorded [s since 1970]; null where that is not known."""
    began = pl.col(c.RECORDING).replace_strict(dict(recording.began), default=None, return_dtype=pl.Float64)
    return recording.tracks.select(c.RECORDING, moment=began + pl.col(c.FRAME) * recording.time_step)
