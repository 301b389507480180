"""The file of a long recording read part by part: what its windows span, and the rows of some of their time."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import polars as pl

from rampcast.errors import RecordingError
from rampcast.horizon import EDGE
from rampcast.recording import columns as c
from rampcast.recording.parquet import refusing_damage
from rampcast.recording.recording import KEY, Recording, checked, read_description


@dataclass(frozen=True)
class Extent:
    """What a window of a recording's file spans.

    Attributes:
        window: its name.
        first, last: times of its first and last rows [s].
        rows, vehicles: how many there are.
    """

    window: str
    first: float
    last: float
    rows: int
    vehicles: int


def extents_of(path: Path) -> tuple[Extent, ...]:
    """Returns what each window of a recording's file spans, in the order of their names; the file is streamed.

    Raises:
        RecordingError: the file is not there, is no recording, or has no rows.
        FormatError: it is damaged.
    """
    step = read_description(path).time_step
    with refusing_damage(path):
        found = (
            pl.scan_parquet(path)
            .group_by(c.RECORDING)
            .agg(pl.col(c.FRAME).min(), pl.col(c.FRAME).max().alias("last"), pl.len(), pl.col(c.VEHICLE).n_unique())
            .sort(c.RECORDING)
            .collect(engine="streaming")
        )
    extents = tuple(
        Extent(window, first * step, last * step, rows, vehicles)
        for window, first, last, rows, vehicles in found.iter_rows()
        if window is not None and first is not None
    )
    if not extents:
        raise RecordingError(f"{path}: a recording without rows; convert the original again")
    return extents


def read_span(path: Path, window: str, begin: float, end: float) -> Recording:
    """Returns the rows of a window from `begin` to `end` [s], both included, of a recording's file; maybe none.

    Groups of rows that lie elsewhere are passed over where the file tells what they span.

    Raises:
        RecordingError: the file is not there, is no recording, or has cells that no recording has.
        FormatError: it is damaged.
    """
    head = read_description(path)
    low, high = math.ceil((begin - EDGE) / head.time_step), math.floor((end + EDGE) / head.time_step)
    is_here = (pl.col(c.RECORDING) == window) & pl.col(c.FRAME).is_between(low, high)
    with refusing_damage(path):
        tracks = pl.scan_parquet(path).filter(is_here).collect(engine="streaming")
    return replace(head, tracks=checked(path, tracks).sort(KEY, maintain_order=True))


def within(recording: Recording, begin: float, end: float) -> Recording:
    """Returns the rows of a recording from `begin` on and before `end` [s]."""
    time = pl.col(c.FRAME) * recording.time_step
    return replace(recording, tracks=recording.tracks.filter((time >= begin - EDGE) & (time < end - EDGE)))
