"""Vehicles of I-24 MOTION, all at once, as rows of a plane at the frames of their recording.

The plane has x to the east and y to the north, in metres; y = 0 at the left edge of both carriageways. Between two
times a vehicle is interpolated linearly; in holes of more than 5 time steps there are no frames.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from rampcast.formats.readers.i24.tracks import (
    HOLE,
    KINDS,
    LANES,
    ON_FRAME,
    ROADS,
    Clock,
    check_times,
    clock_of_times,
    day_of,
)
from rampcast.formats.steps.units import FOOT
from rampcast.formats.steps.vehicles import TYPICAL_SIZES, with_sizes
from rampcast.recording import columns as c
from rampcast.recording.reading import ReadReport
from rampcast.roads.plane import PLANE_SCHEMA, PX, PY, ROAD, SOURCE_LANE

BLOCK = 1 << 15  # [rows] done at once: two dozen arrays of them fit the cache of a core


@dataclass(frozen=True)
class _Frames:
    """Where vehicles are seen.

    Attributes:
        row: the table's last row before the frame, or at it.
        frame: its number.
        low, high: the rows between which it is interpolated; the same behind a vehicle's last one.
        since: frames since `low`; none before a vehicle's first row.
        way: frames from `low` to `high`; 1 where they are the same.
    """

    row: Int[np.ndarray, "row"]
    frame: Float[np.ndarray, "row"]
    low: Int[np.ndarray, "row"]
    high: Int[np.ndarray, "row"]
    since: Float[np.ndarray, "row"]
    way: Float[np.ndarray, "row"]

    def interpolated(self, values: Float[np.ndarray, "moment"]) -> Float[np.ndarray, "row"]:
        """Returns values of the table at the frames."""
        start = values[self.low]
        between = (values[self.high] - start) / self.way * self.since + start
        return np.where(self.since == 0.0, start, between)


def clock_of_rows(table: pl.DataFrame) -> Clock:
    """Returns the clock of a recording, told from the vehicle of the table with the most rows."""
    starts = starts_of(table)
    counts = np.diff(np.r_[starts, table.height])
    longest = int(counts.argmax())
    return clock_of_times(table["time"].to_numpy()[starts[longest] : starts[longest] + counts[longest]])


def starts_of(table: pl.DataFrame) -> Int[np.ndarray, "vehicle"]:
    """Returns the first row of each vehicle."""
    return np.flatnonzero(np.diff(table["number"].to_numpy(), prepend=-1))


def sampled_rows(table: pl.DataFrame, clock: Clock, *, first: int = 1) -> tuple[pl.DataFrame, ReadReport]:
    """Returns vehicles at the frames of their recording, as rows of a plane, and what that found.

    Args:
        table: sorted by number and time, no time of a vehicle twice; columns of `ROWS`.
        clock: of the recording, which is named for its day.
        first: number of the first vehicle.

    Raises:
        Fault: a time is not of this recording.
    """
    starts, time = starts_of(table), table["time"].to_numpy()
    ends = np.r_[starts[1:], table.height][: len(starts)]
    check_times(time[starts], time[ends - 1], clock)
    cuts = np.unique(np.r_[np.searchsorted(starts, np.arange(0, table.height, BLOCK)), len(starts)])
    parts, interpolated = [pl.DataFrame(schema=PLANE_SCHEMA)], 0
    for low, high in pairwise(cuts.tolist()):
        part = table[int(starts[low]) : int(ends[high - 1])]
        rows, between = _sampled(part, starts[low:high] - starts[low], clock, first=first + low)
        parts.append(rows)
        interpolated += between
    rows, filled = with_sizes(pl.concat(parts, rechunk=True))
    off_frames = table.height - (rows.height - interpolated)
    found = ReadReport((), (), 0, rows_interpolated=interpolated, rows_off_frames=off_frames, sizes_filled=filled)
    return rows, found


def _sampled(
    table: pl.DataFrame, starts: Int[np.ndarray, "vehicle"], clock: Clock, *, first: int
) -> tuple[pl.DataFrame, int]:
    """Returns the rows of a plane of some vehicles, numbered from `first`, and how many lie between two rows."""
    counts = np.diff(np.r_[starts, table.height])
    track = np.repeat(np.arange(len(starts)), counts)
    last = (starts + counts - 1)[track]
    place = (table["time"].to_numpy() - clock.start) / clock.step
    frames = _frames(place, last, starts[track])
    nearest, between = _nearest(place, frames, last)
    rows = _rows(table, starts, track, frames, nearest, clock)
    return rows.with_columns(pl.col(c.VEHICLE) + (first - 1)), between


def _frames(
    place: Float[np.ndarray, "moment"], last: Int[np.ndarray, "moment"], first: Int[np.ndarray, "moment"]
) -> _Frames:
    """Returns the frames at which vehicles are seen, or between two moments that are not too far apart.

    Args:
        place: of each row [frames], growing in each vehicle.
        last, first: row of each row's vehicle.
    """
    row = np.arange(len(place))
    after = np.minimum(row + 1, last)
    begin = np.ceil(place - ON_FRAME)
    is_held = place[after] - place <= HOLE
    end = np.floor(np.where(is_held, place[after], place) + ON_FRAME)
    end = np.where(after > row, np.minimum(end, begin[after] - 1), end)  # the next row's frames are not this one's
    counts = np.maximum(end - begin + 1, 0).astype(np.int64)
    before = np.repeat(row, counts)
    offset = np.arange(len(before)) - np.repeat(np.cumsum(counts) - counts, counts)
    frame = begin[before] + offset
    low = np.maximum(before - (place[before] > frame), first[before])
    high = np.minimum(low + 1, last[before])
    way = place[high] - place[low]
    return _Frames(before, frame, low, high, np.maximum(frame - place[low], 0.0), np.where(way > 0, way, 1.0))


def _nearest(
    place: Float[np.ndarray, "moment"], frames: _Frames, last: Int[np.ndarray, "moment"]
) -> tuple[Int[np.ndarray, "row"], int]:
    """Returns the row that is nearest to each frame, and how many frames lie between two rows."""
    since = frames.frame - place[frames.row]
    after = np.minimum(frames.row + 1, last[frames.row])
    nearest = np.where(since <= place[after] - frames.frame, frames.row, after)
    return nearest, int(np.count_nonzero(np.abs(since) > ON_FRAME))


def _rows(
    table: pl.DataFrame,
    starts: Int[np.ndarray, "vehicle"],
    track: Int[np.ndarray, "moment"],
    frames: _Frames,
    nearest: Int[np.ndarray, "row"],
    clock: Clock,
) -> pl.DataFrame:
    """Returns the rows of a plane; what does not change with time is that of a vehicle's first row."""
    vehicle = track[frames.row]
    firsts = table[starts].select("direction", "class", pl.col("length", "width") * FOOT)
    kinds = [KINDS[number] for number in firsts["class"]]
    sizes = firsts.select(pl.when(pl.col(name) > 0).then(pl.col(name)) for name in ("length", "width"))
    length = np.where(sizes["length"].is_null(), [TYPICAL_SIZES[kind][0] for kind in kinds], sizes["length"].to_numpy())
    direction = firsts["direction"].to_numpy().astype(float)
    front = frames.interpolated(table["x"].to_numpy() + (direction * length)[track])
    right = frames.interpolated(table["y"].to_numpy()) * (_sides(table["y"].to_numpy(), starts) * -direction)[vehicle]

    def each(name: str, values: Sequence[object] | pl.Series) -> pl.Series:
        """Returns a column with one value a vehicle."""
        return pl.Series(values, dtype=PLANE_SCHEMA[name]).gather(vehicle)

    def recorded(name: str) -> pl.Series:
        return pl.Series(frames.interpolated(table[name].to_numpy()), nan_to_null=True)

    columns = {
        c.RECORDING: pl.Series([day_of(clock)], dtype=PLANE_SCHEMA[c.RECORDING]).new_from_index(0, len(vehicle)),
        ROAD: each(ROAD, [ROADS[one] for one in firsts["direction"]]),
        c.VEHICLE: (vehicle + 1).astype(np.int32),
        c.FRAME: frames.frame.astype(np.int32),
        PX: front,
        PY: right,
        SOURCE_LANE: _lane_names(table["lane"].gather(nearest)),
        c.LENGTH: each(c.LENGTH, sizes["length"]),
        c.WIDTH: each(c.WIDTH, sizes["width"]),
        c.KIND: each(c.KIND, kinds),
        c.RECORDED_V: recorded("v"),
        c.RECORDED_A: recorded("a"),
    }
    return pl.DataFrame(columns, schema=PLANE_SCHEMA)


def _sides(y: Float[np.ndarray, "moment"], starts: Int[np.ndarray, "vehicle"]) -> Float[np.ndarray, "vehicle"]:
    """Returns 1 where y grows to the right of the road, -1 where it is counted below zero."""
    low, high = np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
    sides = np.where(low >= 0, 1.0, -1.0)
    ends = np.r_[starts[1:], len(y)]
    for vehicle in np.flatnonzero((low < 0) & (high >= 0)):
        sides[vehicle] = 1.0 if np.median(y[starts[vehicle] : ends[vehicle]]) >= 0 else -1.0
    return sides


def _lane_names(numbers: pl.Series) -> pl.Series:
    """Returns the names of lanes; null off the road, and where there is no number."""
    names = pl.Series([str(number) if number else None for number in LANES], dtype=pl.Categorical())
    return names.gather(numbers)
