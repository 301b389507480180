"""Resampling of tracks whose frame rate does not fit the sampling at 0.2 s, as 29.97 Hz or 12.5 Hz."""

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.recording import columns as c

EVEN_STEP = 0.1  # [s] NGSIM's own, for which smoothing is described (method page, section 3)
ON_FRAME = 1e-6  # frames that a moment may be off a frame to be that frame


def resample(
    tracks: pl.DataFrame, starts: Int[np.ndarray, "track"], *, time_step: float
) -> tuple[pl.DataFrame, Int[np.ndarray, "even"]]:
    """Returns the tracks at every multiple of 0.1 s that they span, and the rows where each begins.

    x and y are interpolated linearly between the two frames beside a moment, which leaves a curved path by at most
    acceleration * time_step^2 / 8 (4 cm at 8 m/s^2 and 0.2 s); all else is that of the nearer frame. A row is observed
    if all that it was interpolated from is. A track that meets no multiple of 0.1 s is left out.

    Args:
        tracks: columns of `columns.SCHEMA` and `columns.OBSERVED`, no frame of a track missing.
        starts: row where each track begins, growing; the first is 0.
        time_step: time between two frames [s].
    """
    frame = tracks[c.FRAME].to_numpy().astype(np.int64)
    last = np.append(starts[1:], len(frame)) - 1
    per_frame = time_step / EVEN_STEP
    first_moment = np.ceil((frame[starts] - ON_FRAME) * per_frame).astype(np.int64)
    counts = np.floor((frame[last] + ON_FRAME) * per_frame).astype(np.int64) - first_moment + 1
    even_starts = np.concatenate([[0], np.cumsum(counts)])
    moment = np.arange(even_starts[-1]) - np.repeat(even_starts[:-1] - first_moment, counts)
    row = moment / per_frame - np.repeat(frame[starts] - starts, counts)  # a track's rows follow each other like frames
    row = np.clip(row, np.repeat(starts, counts), np.repeat(last, counts))
    row = np.where(np.abs(row - np.round(row)) < ON_FRAME, np.round(row), row)
    before, after = np.floor(row).astype(np.int64), np.ceil(row).astype(np.int64)
    observed = tracks[c.OBSERVED].to_numpy()
    return _rows_at(tracks, before, after, row - before).with_columns(
        pl.Series(c.FRAME, moment, dtype=pl.Int32),
        pl.Series(c.OBSERVED, _both(observed, before, after)),
    ), even_starts[:-1][counts > 0]


def _rows_at(
    tracks: pl.DataFrame,
    before: Int[np.ndarray, "row"],
    after: Int[np.ndarray, "row"],
    share: Float[np.ndarray, "row"],
) -> pl.DataFrame:
    """Returns the nearer of two rows, with x and y in between: `share` 0 is `before`, 1 is `after`."""
    values = {name: tracks[name].to_numpy() for name in (c.X, c.Y)}
    between = {name: (1 - share) * one[before] + share * one[after] for name, one in values.items()}
    nearest = np.where(share <= 0.5, before, after)
    return tracks[nearest].with_columns(**{name: pl.Series(one) for name, one in between.items()})


def _both(
    flags: Bool[np.ndarray, "frame"], before: Int[np.ndarray, "row"], after: Int[np.ndarray, "row"]
) -> Bool[np.ndarray, "row"]:
    return np.asarray(flags[before] & flags[after])
