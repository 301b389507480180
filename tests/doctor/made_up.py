"""Made-up traffic without any fault, and the means to put one in at a known place."""

from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import load_site

SITE = load_site("i80")
SPEED = 12.0  # [m/s] of every vehicle
TIME_STEP = 0.1  # [s]
LENGTH = 5.0  # [m]
SECTION = 480.0  # [m] over which vehicles are seen: 40 s
HEADWAY = 3.0  # [s] in lanes 5 and 6
VEHICLES = 24  # of each of these lanes
MERGE = 160.0  # [m] where a vehicle of lane 7 crosses the line, half-way between two of lane 6
MERGE_TIME = 4.0  # [s]
FIRST_OF = {5: 100, 6: 200, 7: 300}  # id of the first vehicle of each lane


@cache
def sound() -> Recording:
    """Returns traffic of one speed in lanes 5 and 6, and vehicles that merge from lane 7 between two of lane 6."""
    parts = [
        vehicle(FIRST_OF[lane] + number, lane=lane, start=number * HEADWAY)
        for lane in (5, 6)
        for number in range(VEHICLES)
    ]
    parts += [merging(FIRST_OF[7] + n, start=(2 * n + 0.5) * HEADWAY) for n in range(VEHICLES // 2)]
    return recorded(*parts)


def recorded(*tracks: pl.DataFrame) -> Recording:
    """Returns the tracks as a recording, sorted."""
    table = pl.concat(tracks).sort(c.RECORDING, c.VEHICLE, c.FRAME)
    return Recording(tracks=table, site=SITE, time_step=TIME_STEP, source="made up for a test")


def vehicle(
    number: int, *, lane: int, start: float = 30.0, x: float | None = None, seconds: float | None = None
) -> pl.DataFrame:
    """Returns a vehicle that drives at `SPEED` through the section and weaves a little in its lane.

    Args:
        number: its id.
        lane: its lane.
        start: when it begins [s].
        x: where it begins [m]; at the section's begin if not given.
        seconds: for how long it is seen; to the section's end if not given.
    """
    first = 0.0 if x is None else x
    lasts = (SECTION - first) / SPEED if seconds is None else seconds
    return driven(number, lane=lane, start=start, x=first + SPEED * times(lasts))


def merging(number: int, *, start: float) -> pl.DataFrame:
    """Returns a vehicle of lane 7 that moves to lane 6 around `MERGE`; its label changes on the line."""
    table = driven(number, lane=7, start=start, x=SPEED * times(SECTION / SPEED))
    t = (table[c.X].to_numpy() - MERGE) / SPEED
    share = np.clip(t / MERGE_TIME + 0.5, 0.0, 1.0)
    share = share**2 * (3 - 2 * share)
    y = table[c.Y].to_numpy() + share * (SITE.lane_centre(6) - SITE.lane_centre(7))
    lane = np.where(t < 0, 7, 6)
    return table.with_columns(pl.Series(c.Y, y), pl.Series(c.LANE, lane, dtype=pl.Int16))


def driven(number: int, *, lane: int, start: float, x: np.ndarray) -> pl.DataFrame:
    """Returns a vehicle of given positions [m], one a frame."""
    frame = round(start / TIME_STEP) + np.arange(len(x))
    values = {
        c.RECORDING: ["i80-1"] * len(x),
        c.VEHICLE: np.full(len(x), number),
        c.FRAME: frame,
        c.X: x,
        c.Y: SITE.lane_centre(lane) + 0.1 * np.sin(np.arange(len(x)) / 25.0),
        c.LANE: np.full(len(x), lane),
        c.LENGTH: np.full(len(x), LENGTH),
        c.WIDTH: np.full(len(x), 1.9),
        c.KIND: ["car"] * len(x),
    }
    return pl.DataFrame(values).cast(pl.Schema(c.SCHEMA))


def times(seconds: float) -> np.ndarray:
    """Returns the times of the frames of so many seconds [s]."""
    return np.arange(round(seconds / TIME_STEP) + 1) * TIME_STEP


def with_tracks(tracks: pl.DataFrame) -> Recording:
    """Returns the sound recording with other rows, in the order that is given."""
    return replace(sound(), tracks=tracks)


def changed(where: pl.Expr, **values: pl.Expr) -> Recording:
    """Returns the sound recording with other values in some rows."""
    changes = [pl.when(where).then(value).otherwise(pl.col(name)).alias(name) for name, value in values.items()]
    return with_tracks(sound().tracks.with_columns(changes).cast(pl.Schema(c.SCHEMA)))


def without(where: pl.Expr) -> Recording:
    """Returns the sound recording without some rows."""
    return with_tracks(sound().tracks.filter(~where))


def together_with(*tracks: pl.DataFrame) -> Recording:
    """Returns the sound recording with more vehicles."""
    return recorded(sound().tracks, *tracks)


def of(number: int, first: int, last: int | None = None) -> pl.Expr:
    """Returns whether a row is a vehicle's, from its own first frame counted, to the last one given (or to its end)."""
    begin = sound().tracks.filter(pl.col(c.VEHICLE) == number)[c.FRAME].min()
    frame = pl.col(c.FRAME) - begin
    return (pl.col(c.VEHICLE) == number) & (frame >= first) & (frame <= (first if last is None else last))


def frame_of(number: int, own: int) -> int:
    """Returns the frame that is a vehicle's own so-manieth."""
    return int(sound().tracks.filter(pl.col(c.VEHICLE) == number)[c.FRAME].min()) + own
