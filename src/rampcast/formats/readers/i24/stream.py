"""The vehicles of I-24 MOTION's json files as rows in a plane, a batch at a time.

The plane has x to the east and y to the north, in metres; y = 0 at the left edge of both carriageways.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.json_array import read_array
from rampcast.formats.readers.i24.tracks import (
    EAST,
    LANES,
    RIGHT,
    WEST,
    Clock,
    Fault,
    Layout,
    Sampled,
    clock_of,
    sampled,
    track_of,
)
from rampcast.formats.steps.clock import check_one_step
from rampcast.formats.steps.vehicles import with_sizes
from rampcast.recording import columns as c
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows, ReadReport
from rampcast.roads.plane import PLANE_SCHEMA, PX, PY, ROAD, SOURCE_LANE

ROADS = {WEST: "west", EAST: "east"}
ENOUGH = 200_000  # [rows] of a batch: some 20 MB
MOST_LOOKED_AT = 10_000  # elements among which the first vehicles must be
FIRST = 20  # vehicles that tell the time step: it takes one that is seen without holes for some time
WORD = "vehicle"


@dataclass(frozen=True)
class Batch:
    """Some vehicles.

    Attributes:
        rows: columns of `PLANE_SCHEMA`; vehicles are numbered from 1 in the order in which they come.
        names: of the vehicles in the source.
        time_step: between two frames [s].
        report: what reading found.
    """

    rows: pl.DataFrame
    names: tuple[str, ...]
    time_step: float
    report: ReadReport


@dataclass
class _Gathering:
    """What has been read and not yet been given away."""

    files: list[str] = field(default_factory=list)
    vehicles: list[Sampled] = field(default_factory=list)
    faults: list[BadRow] = field(default_factory=list)
    rows: int = 0
    rows_read: int = 0
    rows_skipped: int = 0


def read_batches(paths: Sequence[Path], layout: Layout, bad_rows: BadRows) -> Iterator[Batch]:
    """Yields the vehicles of the files; those of several days in the order of days.

    Raises:
        FormatError: a file is not there, malformed, or without vehicles; a vehicle is not as the layout says and those
            are not to be skipped, or comes twice; or the files are of different rates.
    """
    clocks = [(path, _clock(path, layout)) for path in paths]
    firsts: dict[str, Clock] = {}
    check_one_step(paths, [clock.step for _, clock in clocks])
    for _, clock in sorted(clocks, key=lambda pair: day_of(pair[1])):
        firsts.setdefault(day_of(clock), clock)
    known: dict[str, str] = {}
    for path, clock in sorted(clocks, key=lambda pair: day_of(pair[1])):
        yield from _batches_of(path, layout, firsts[day_of(clock)], known, bad_rows)


def kept_ids(names: Sequence[str]) -> list[int] | None:
    """Returns the ids of vehicles if their names are whole numbers that grow; None if they are not and get new ones."""
    if not all(name.isascii() and name.isdecimal() and len(name) <= len(str(c.LARGEST)) for name in names):
        return None
    ids = [int(name) for name in names]
    grows = all(before < after for before, after in pairwise(ids))
    return ids if grows and ids and ids[-1] <= c.LARGEST else None


def _clock(path: Path, layout: Layout) -> Clock:
    """Returns the clock of a file, from its first good vehicles."""
    fault, tracks = "there is none in the array", []
    for number, (_, value) in enumerate(read_array(path, element=WORD)):
        try:
            tracks.append(track_of(value, layout))
        except Fault as error:
            fault = str(error)
        if len(tracks) == FIRST or number == MOST_LOOKED_AT:
            break
    if not tracks:
        raise FormatError(f"{path}: no {WORD} can be read: {fault}. See docs/formats/{layout.source}.md")
    return clock_of(tracks)


def day_of(clock: Clock) -> str:
    """Returns the day of a recording (UTC)."""
    return datetime.fromtimestamp(clock.start + clock.step, UTC).date().isoformat()


def _batches_of(path: Path, layout: Layout, clock: Clock, known: dict[str, str], bad_rows: BadRows) -> Iterator[Batch]:
    """Yields the vehicles of one file; those so far are `known` by name, and it adds its own."""
    now = _Gathering()
    for number, (name, value) in enumerate(read_array(path, element=WORD), start=1):
        if number == 1:
            now.files.append(name)
        moments = _moments(value)
        now.rows_read += moments
        try:
            track = track_of(value, layout)
            if track.id in known:
                raise Fault(f"{layout.id} '{track.id}' came before, as {known[track.id]}; was a file given twice?")
            now.vehicles.append(sampled(track, clock))
        except Fault as error:
            fault = BadRow(name, number, 0, str(error), WORD)
            if bad_rows is BadRows.RAISE:
                raise FormatError(f"{fault}. Mend the file, or skip such vehicles with --skip-bad-rows") from error
            now.faults.append(fault)
            now.rows_skipped += moments
            continue
        known[track.id] = f"{WORD} {number} of {path.name}"
        now.rows += len(now.vehicles[-1].frames)
        if now.rows >= ENOUGH:
            yield _batch(now, layout, clock, first=len(known) - len(now.vehicles) + 1)
            now = _Gathering()
    yield _batch(now, layout, clock, first=len(known) - len(now.vehicles) + 1)


def _moments(value: Any) -> int:
    """Returns how many rows an element would be; 1 if it is no vehicle at all."""
    times = value.get("timestamp") if isinstance(value, dict) else None
    return len(times) if isinstance(times, list) else 1


def _batch(now: _Gathering, layout: Layout, clock: Clock, *, first: int) -> Batch:
    rows, filled = with_sizes(plane_rows(now.vehicles, clock, first=first))
    report = ReadReport(
        files=tuple(now.files),
        forms=(layout.title,) * len(now.files),
        rows_read=now.rows_read,
        rows_skipped=now.rows_skipped,
        skipped=tuple(now.faults[:MOST_LISTED]),
        rows_interpolated=sum(one.between for one in now.vehicles),
        rows_off_frames=sum(one.off for one in now.vehicles),
        sizes_filled=filled,
    )
    return Batch(rows, tuple(one.track.id for one in now.vehicles), clock.step, report)


def plane_rows(vehicles: Sequence[Sampled], clock: Clock, *, first: int) -> pl.DataFrame:
    """Returns the vehicles as rows of a plane: who drives west has the right of the road to the north.

    Args:
        vehicles: in the order of their numbers.
        clock: of the recording, which is named for its day.
        first: number of the first of them.
    """
    counts = [len(one.frames) for one in vehicles]
    places = np.repeat(np.arange(len(counts)), counts)
    tracks = [one.track for one in vehicles]

    def each(name: str, values: Sequence[Any]) -> pl.Series:
        """Returns a column with one value a vehicle."""
        return pl.Series(values, dtype=PLANE_SCHEMA[name])[places]

    def joined(name: str) -> Any:
        """Returns a column of what the vehicles have at the frames; nothing if they have it not."""
        arrays = [one.values[name] for one in vehicles if name in one.values]
        return pl.Series(np.concatenate(arrays), nan_to_null=True) if arrays else None

    lanes = [one.lane for one in vehicles if one.lane is not None]
    number = pl.Series(np.concatenate(lanes)) if lanes else None
    west = np.repeat([-float(track.direction) for track in tracks], counts)
    columns: dict[str, Any] = {
        c.RECORDING: each(c.RECORDING, [day_of(clock)] * len(tracks)),
        ROAD: each(ROAD, [ROADS[track.direction] for track in tracks]),
        c.VEHICLE: each(c.VEHICLE, range(first, first + len(tracks))),
        c.FRAME: np.concatenate([np.zeros(0, np.int32), *(one.frames for one in vehicles)]),
        PX: joined(c.X),
        PY: joined(RIGHT) * west if vehicles else None,
        SOURCE_LANE: None if number is None else lane_names(number),
        c.LENGTH: each(c.LENGTH, [track.length for track in tracks]).fill_nan(None),
        c.WIDTH: each(c.WIDTH, [track.width for track in tracks]).fill_nan(None),
        c.KIND: each(c.KIND, [track.kind for track in tracks]),
        c.RECORDED_V: joined(c.RECORDED_V),
        c.RECORDED_A: joined(c.RECORDED_A),
    }
    return pl.DataFrame(columns, schema=PLANE_SCHEMA)


def lane_names(numbers: pl.Series) -> pl.Series:
    """Returns the names of lanes; null off the road."""
    names = pl.Series([str(number) if number else None for number in LANES], dtype=pl.Categorical())
    return names.gather(numbers)
