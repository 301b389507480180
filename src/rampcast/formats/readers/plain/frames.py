"""Frames of a table: from its times and the time step, which the times tell where nobody says it."""

from collections.abc import Sequence

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.steps.clock import numbered, told_step
from rampcast.recording import columns as c

TIME = "time"
TRACK = (c.RECORDING, c.VEHICLE)
PLACES, LOOKED_AT = 3, 50_000  # places in a table, and rows at each, that tell the time step
SPARSE = 1.0  # [s] rows of a vehicle that lie further apart are no trajectory


def with_frames(
    table: pl.DataFrame, time_step: float | None, *, files: Sequence[str]
) -> tuple[pl.DataFrame, float, int]:
    """Returns the rows with frames, the time step [s], and how many rows' times are off their frame.

    Frames that are given are kept; else they are as in `numbered`.

    Args:
        table: rows with `recording`, `vehicle` and `frame` or `time` [s], null where not known.
        time_step: time between two frames [s]; None tells it from the times.
        files: their names for messages.

    Raises:
        FormatError: the rows are no trajectories, or nothing tells the time step.
    """
    has_frames = table[c.FRAME].null_count() < table.height
    some = _some_tracks(table, c.FRAME if has_frames else TIME)
    if time_step is None:
        time_step = _told_step(some, per_frame=has_frames, files=files)
    _check_tracks(some, time_step if has_frames else 1.0, c.FRAME if has_frames else TIME, files)
    if has_frames:
        return table.with_columns(pl.col(c.FRAME).cast(pl.Int32)), time_step, 0
    frames, slips = numbered(", ".join(files), table[TIME], time_step)
    return table.with_columns(pl.Series(c.FRAME, frames)), time_step, slips


def _some_tracks(table: pl.DataFrame, moment: str) -> pl.DataFrame:
    """Returns some rows by vehicle in order of time, with the time and frames since the row before."""
    rows = table.select(*TRACK, c.FRAME, TIME)
    if rows.height > PLACES * LOOKED_AT:
        starts = np.linspace(0, rows.height - LOOKED_AT, PLACES).astype(int)
        rows = pl.concat([rows.slice(int(start), LOOKED_AT) for start in starts])
    numbers = rows.with_columns(pl.col(TRACK).to_physical())  # sorted faster than words
    return numbers.sort(*TRACK, moment).with_columns(
        pl.col(name).diff().over(TRACK).alias(f"{name}_step") for name in (c.FRAME, TIME)
    )


def _told_step(some: pl.DataFrame, *, per_frame: bool, files: Sequence[str]) -> float:
    """Returns the time step [s] that the times of some tracks tell."""
    elapsed = some.filter(
        (pl.col("time_step") > 0) & (pl.col("frame_step") > 0) if per_frame else pl.col("time_step") > 0
    )
    if elapsed.is_empty():
        raise FormatError(
            f"{', '.join(files)}: its times do not tell how long a frame is: no vehicle has two rows at two times."
            " Expected a row for every vehicle at every moment"
        )
    return told_step(elapsed["time_step"].to_numpy(), elapsed["frame_step"].to_numpy() if per_frame else None)


def _check_tracks(some: pl.DataFrame, unit: float, moment: str, files: Sequence[str]) -> None:
    """Raises if the rows of most vehicles lie so far apart that they are events and no trajectories."""
    gaps = some[f"{moment}_step"].drop_nulls() * unit
    middle = float(np.median(gaps.to_numpy())) if gaps.len() else None
    if middle is None or middle > SPARSE:
        what = (
            "no vehicle has two rows" if middle is None else f"half of the rows lie {middle:.1f} s after the one before"
        )
        raise FormatError(
            f"{', '.join(files)}: these are events, not trajectories: {what} of its vehicle. Expected a row for every "
            f"vehicle at every moment, {SPARSE:g} s apart at most. If the times are in milliseconds or frames, say so "
            "with --mapping"
        )
