"""Frames of a table: from its times and the time step, which the times tell where nobody says it."""

from collections.abc import Sequence

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.steps.clock import HELD, numbered, told_step
from rampcast.recording import columns as c

TIME = "time"
TRACK = (c.RECORDING, c.VEHICLE)
PLACES, LOOKED_AT = 3, 50_000  # places in a table, and rows at each, that tell the time step
OFF_STEP, MANY = 0.2, 0.1  # of a time step, and of the vehicles, that tell another rate
FEWEST = 5  # steps of a vehicle that tell its rate
FRAMES_OFF, FEW_OFF = 1.0, 0.01  # [s] from the time of a frame, and the share of rows beyond that is no slip of a clock
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
        _check_one_rate(some, time_step, c.FRAME if has_frames else TIME, files)
    _check_tracks(some, time_step if has_frames else 1.0, c.FRAME if has_frames else TIME, files)
    if has_frames:
        _check_frames(table, _own_step(some, time_step), files)
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


def _check_one_rate(some: pl.DataFrame, time_step: float, moment: str, files: Sequence[str]) -> None:
    """Raises if many vehicles are seen at moments that lie between those of most, as another camera's are."""
    unit = time_step if moment == c.FRAME else 1.0
    later = some.filter(pl.col(f"{moment}_step") > 0)
    own = later.group_by(TRACK).agg(pl.len(), step=pl.col(f"{moment}_step").quantile(0.5, "lower") * unit)
    steps = own.filter(pl.col("len") >= FEWEST)["step"].to_numpy()
    off = np.abs(steps / time_step - np.maximum(np.rint(steps / time_step), 1.0)) > OFF_STEP
    if len(steps) and off.mean() > MANY:
        shortest, longest = float(steps.min()), float(steps.max())
        are_multiples = np.abs(steps / shortest - np.rint(steps / shortest)).max() < OFF_STEP
        other = f", or say in a mapping that all are multiples of the shortest (time_step = {shortest:g})"
        raise FormatError(
            f"{', '.join(files)}: its vehicles are not seen at the same moments: some every {shortest:g} s, others "
            f"every {longest:g} s. Convert the vehicles of each time step by themselves{other if are_multiples else ''}"
        )


def _own_step(some: pl.DataFrame, time_step: float) -> float:
    """Returns the time from frame to frame [s] that the times tell, not rounded; without times, the time step."""
    held = some.filter(pl.col("frame_step").is_between(1, HELD) & (pl.col("time_step") > 0))
    elapsed, frames = (held[name].to_numpy().sum() for name in ("time_step", "frame_step"))
    return float(elapsed / frames) if held.height else time_step


def _check_frames(table: pl.DataFrame, own_step: float, files: Sequence[str]) -> None:
    """Raises if frames are not those of the times, as where each vehicle's own are counted from 0.

    A time step that is said, and off what the times tell by little, makes frames drift, and is no fault of theirs.
    """
    began = pl.col(TIME) - pl.col(c.FRAME) * own_step
    known = table.select(*TRACK, c.FRAME, TIME, began=began).drop_nulls("began")
    off = known.with_columns(off=(pl.col("began") - pl.col("began").median().over(c.RECORDING)).abs())
    wrong = off.filter(pl.col("off") > FRAMES_OFF)
    if wrong.height > FEW_OFF * known.height:
        worst = wrong.sort("off").row(-1, named=True)
        raise FormatError(
            f"{', '.join(files)}: frames and times do not go together in {wrong.height:,} of {known.height:,} rows; "
            f"of vehicle {worst[c.VEHICLE]} frame {worst[c.FRAME]} is at {worst[TIME]:g} s, {worst['off']:,.1f} s off. "
            "Are frames counted anew for each vehicle? Rename that column, or leave it out of the mapping: they follow "
            "from times then"
        )


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
