"""Times of a table that are written out: as seconds, with a fault for each that cannot be read."""

from dataclasses import replace

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.readers.plain.mapping import TableMapping
from rampcast.formats.steps.vehicles import without_rows
from rampcast.formats.steps.written_times import WRITTEN, seconds_written
from rampcast.formats.tables.columns import SHOWN, Rows, advice
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows

EXAMPLES = {"iso": "2026-11-28T13:05:02.1+01:00", "clock": "13:05:02.1"}


def with_times(rows: Rows, mapping: TableMapping, bad_rows: BadRows) -> Rows:
    """Returns the rows with seconds for times that are written out, without those whose time cannot be read.

    Raises:
        FormatError: one cannot be read and such rows are not to be skipped, or none can.
    """
    for column, written in _written(mapping).items():
        seconds = seconds_written(rows.table[column], written, mapping.timezone)
        wrong = seconds.is_null()
        if wrong.any():
            is_of_clock = seconds_written(rows.table[column], written).is_not_null()
            rows = _without(rows, column, _wanted(written, mapping.timezone), wrong, is_of_clock, bad_rows)
            seconds = seconds.filter(~wrong)
        rows = replace(rows, table=rows.table.with_columns(seconds.alias(column)))
    return rows


def _written(mapping: TableMapping) -> dict[str, str]:
    times = (entries["time"] for entries in mapping.vehicles if "time" in entries)
    return {entry.column: entry.written for entry in times if entry.written}


def _wanted(written: str, timezone: str) -> tuple[str, str]:
    """Returns what is wanted of a time that cannot be read, and of one that can in another time zone."""
    zone = (
        f"a time that comes once in {timezone}, where clocks are set: with its zone (+01:00), or timezone = "
        '"UTC" of a clock that is not set'
    )
    return f"a time as {EXAMPLES[written]}" if written in WRITTEN else f"a time as {written} says", zone


def _without(
    rows: Rows, column: str, wanted: tuple[str, str], wrong: pl.Series, is_of_clock: pl.Series, bad_rows: BadRows
) -> Rows:
    texts = rows.table[column]
    faults = [
        BadRow(
            rows.file,
            place + 1,
            0,
            f"{column}: expected {wanted[int(is_of_clock[place])]}, found '{texts[place]!s:.{SHOWN}}'",
            "row",
        )
        for place in wrong.arg_true().head(MOST_LISTED).to_list()
    ]
    if bad_rows is BadRows.RAISE:
        raise FormatError(advice(faults[0]))
    if wrong.all():
        raise FormatError(f"{rows.file}: none of its {len(wrong):,} rows can be read. {faults[0]}")
    return without_rows(rows, wrong, faults)
