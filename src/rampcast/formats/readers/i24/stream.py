"""The vehicles of I-24 MOTION's json files as rows in a plane, a batch at a time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.json_array import read_array
from rampcast.formats.readers.i24.table import sampled_rows
from rampcast.formats.readers.i24.tracks import (
    Clock,
    Fault,
    Keys,
    Track,
    check_times,
    clock_of,
    day_of,
    table_of,
    track_of,
)
from rampcast.formats.steps.clock import check_one_step
from rampcast.recording import columns as c
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows, ReadReport, join_reports

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
    tracks: list[Track] = field(default_factory=list)
    faults: list[BadRow] = field(default_factory=list)
    rows: int = 0
    rows_read: int = 0
    rows_skipped: int = 0


def read_batches(paths: Sequence[Path], keys: Keys, bad_rows: BadRows) -> Iterator[Batch]:
    """Yields the vehicles of the files; those of several days in the order of days.

    Raises:
        FormatError: a file is not there, malformed, or without vehicles; a vehicle is not as the keys say and those
            are not to be skipped, or comes twice; or the files are of different rates.
    """
    clocks = [(path, _clock(path, keys)) for path in paths]
    firsts: dict[str, Clock] = {}
    check_one_step(paths, [clock.step for _, clock in clocks])
    for _, clock in sorted(clocks, key=lambda pair: day_of(pair[1])):
        firsts.setdefault(day_of(clock), clock)
    known: dict[str, str] = {}
    for path, clock in sorted(clocks, key=lambda pair: day_of(pair[1])):
        yield from _batches_of(path, keys, firsts[day_of(clock)], known, bad_rows)


def kept_ids(names: Sequence[str], *, room: int = 0) -> list[int] | None:
    """Returns the ids of vehicles if their names are whole numbers that grow; None if they are not and get new ones.

    `room` is how many more ids there must be above them.
    """
    if not all(name.isascii() and name.isdecimal() and len(name) <= len(str(c.LARGEST)) for name in names):
        return None
    ids = [int(name) for name in names]
    grows = all(before < after for before, after in pairwise(ids))
    return ids if grows and ids and ids[-1] + room <= c.LARGEST else None


def _clock(path: Path, keys: Keys) -> Clock:
    """Returns the clock of a file, from its first good vehicles."""
    fault, tracks = "there is none in the array", []
    for number, (_, value) in enumerate(read_array(path, element=WORD)):
        try:
            tracks.append(track_of(value, keys))
        except Fault as error:
            fault = str(error)
        if len(tracks) == FIRST or number == MOST_LOOKED_AT:
            break
    if not tracks:
        raise FormatError(f"{path}: no {WORD} can be read: {fault}. See docs/formats/{keys.source}.md")
    return clock_of(tracks)


def _batches_of(path: Path, keys: Keys, clock: Clock, known: dict[str, str], bad_rows: BadRows) -> Iterator[Batch]:
    """Yields the vehicles of one file; those so far are `known` by name, and it adds its own."""
    now = _Gathering()
    for number, (name, value) in enumerate(read_array(path, element=WORD), start=1):
        if number == 1:
            now.files.append(name)
        moments = _moments(value)
        now.rows_read += moments
        try:
            track = track_of(value, keys)
            if track.id in known:
                raise Fault(f"{keys.id} '{track.id}' came before, as {known[track.id]}; was a file given twice?")
            check_times(track.time[:1], track.time[-1:], clock)
        except Fault as error:
            fault = BadRow(name, number, 0, str(error), WORD)
            if bad_rows is BadRows.RAISE:
                raise FormatError(f"{fault}. Mend the file, or skip such vehicles with --skip-bad-rows") from error
            now.faults.append(fault)
            now.rows_skipped += moments
            continue
        known[track.id] = f"{WORD} {number} of {path.name}"
        now.tracks.append(track)
        now.rows += moments
        if now.rows >= ENOUGH:
            yield _batch(now, keys, clock, first=len(known) - len(now.tracks) + 1)
            now = _Gathering()
    yield _batch(now, keys, clock, first=len(known) - len(now.tracks) + 1)


def _moments(value: Any) -> int:
    """Returns how many rows an element would be; 1 if it is no vehicle at all."""
    times = value.get("timestamp") if isinstance(value, dict) else None
    return len(times) if isinstance(times, list) else 1


def _batch(now: _Gathering, keys: Keys, clock: Clock, *, first: int) -> Batch:
    rows, found = sampled_rows(table_of(now.tracks), clock, first=first)
    report = ReadReport(
        files=tuple(now.files),
        forms=(keys.title,) * len(now.files),
        rows_read=now.rows_read,
        rows_skipped=now.rows_skipped,
        skipped=tuple(now.faults[:MOST_LISTED]),
    )
    names = tuple(track.id for track in now.tracks)
    return Batch(rows, names, clock.step, join_reports([report, found]))
