"""Rows of tables with named columns, csv or parquet: a fast path, and a careful one that finds each bad row.

A format lists the columns it wants; what is not listed is not read. Files are read in chunks, so a whole text is never
in memory; a chunk in which anything is not as expected is read again with care.
"""

import io
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import BYTE_ORDER_MARK, Head
from rampcast.formats.files.sources import open_source, parse_ahead, read_chunks
from rampcast.formats.tables.blanks import as_csv
from rampcast.formats.tables.columns import (
    OF_ALL,
    Column,
    Layout,
    Part,
    Rows,
    advice,
    missing,
    other_rows,
    place_of,
    with_keys,
)
from rampcast.formats.tables.rows_careful import parse_carefully
from rampcast.formats.tables.rows_typed import read_typed
from rampcast.formats.tables.thousands import has_decimal_commas, has_decimal_points, large
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows

BLOCK = 1 << 17  # letters compared at once: what that gives fits the cache of a core
FLOATS = (pl.Float32, pl.Float64)
PACKED = (b"\x1f\x8b", b"(\xb5/\xfd", b"x\x01", b"x^", b"x\x9c", b"x\xda")  # polars would unpack it
PIECE = 1 << 20  # [bytes] read with care together: as Python's own objects lines take twenty times their size


def read_rows(head: Head, columns: Sequence[Column], *, bad_rows: BadRows = BadRows.RAISE) -> Rows:
    """Returns the rows of a csv (plain, or in a .gz or .zip), a parquet file or a table in memory.

    Raises:
        FormatError: the file is not there, lacks a column or any row, or has a bad row and those are not to be skipped.
    """
    rows = (_read_csv if head.is_text else read_typed)(head, columns, bad_rows)
    if not rows.table.height and rows.faults and not rows.others:
        raise FormatError(
            f"{rows.file}: none of its {rows.faults_counted:,} rows can be read. {rows.faults[0]}. {OF_ALL}"
        )
    if not rows.table.height and not rows.others:
        raise FormatError(f"{rows.file}: the file has a header but no rows; get the file again")
    return rows


def _read_csv(head: Head, columns: Sequence[Column], bad_rows: BadRows) -> Rows:
    layout = _layout(head, columns)
    tables: list[pl.DataFrame] = []
    faults: list[BadRow] = []
    others: Counter[str] = Counter()
    counted = grouped = 0
    with open_source(head.path) as (name, stream):
        chunks = read_chunks(name, stream)
        if has_decimal_commas(head):
            chunks = (chunk.replace(b",", b".") for chunk in chunks)
        for part in _parts(_skip(next(chunks, b""), layout), chunks, layout):
            if part.faults and bad_rows is BadRows.RAISE:
                is_any_good = any(table.height for table in (*tables, part.table))
                raise FormatError(advice(part.faults[0], 0 if is_any_good else len(part.faults)))
            tables.append(part.table)
            faults.extend(part.faults[: MOST_LISTED - len(faults)])
            counted += len(part.faults)
            others.update(part.others)
            grouped += part.grouped
    return Rows(head.name, pl.concat(tables, rechunk=True), tuple(faults), counted, others, grouped)


def _parts(first: bytes, chunks: Iterator[bytes], layout: Layout) -> Iterator[Part]:
    """Yields the rows of each chunk: fast, and with care where anything is not as expected."""
    line = layout.header.lines + 1
    styles: dict[str, bool] = {}
    for chunk, (lines, found) in parse_ahead(chain([first], chunks), lambda chunk: _parse(chunk, layout)):
        is_alike = found and all(styles.get(name, style) == style for name, style in found.styles.items())
        for part in [found] if found and is_alike else _carefully(chunk, layout, line, styles):
            styles.update(part.styles)
            yield part
        line += lines


def _carefully(chunk: bytes, layout: Layout, first_line: int, styles: Mapping[str, bool]) -> Iterator[Part]:
    """Yields the rows of each piece of a chunk."""
    start = 0
    while start < len(chunk):
        end = chunk.find(b"\n", start + PIECE) + 1 or len(chunk)
        yield parse_carefully(chunk[start:end], layout, first_line, styles)
        first_line += _count(chunk[start:end], b"\n")
        start = end


def _skip(chunk: bytes, layout: Layout) -> bytes:
    start = 0
    for _ in range(layout.header.lines):
        start = chunk.find(b"\n", start) + 1 or len(chunk)
    return chunk[start:]


def _layout(head: Head, columns: Sequence[Column]) -> Layout:
    name, header = head.name, head.header
    if header is None:
        names = ", ".join(column.spellings[0] for column in columns if not column.optional)
        raise FormatError(f"{name}: expected a csv whose first line names its columns, among them {names}")
    where, wanted = f"{name}, line {header.lines}", []
    for column in columns:
        index = place_of(column, header.names, where)
        if index is None and not column.optional:
            raise FormatError(f"{where}: {missing(column, header.names)}")
        if index is not None:
            wanted.append((index, column))
    return Layout(name, header, tuple(sorted(wanted, key=lambda pair: pair[0])), has_decimal_points(head))


def _parse(chunk: bytes, layout: Layout) -> tuple[int, Part | None]:
    """Returns the number of line ends in a chunk of whole lines, and its rows; None if anything is not as expected."""
    ends = _count(chunk, b"\n")
    text = _without_blank_ends(chunk.removeprefix(BYTE_ORDER_MARK))
    if text and layout.separator == b" ":
        text, layout = as_csv(text, layout)
    rows = (ends if text is chunk else _count(text, b"\n")) + (not text.endswith(b"\n"))
    return ends, _parse_text(text, rows, layout) if text else Part(pl.DataFrame(schema=layout.schema))


def _parse_text(text: bytes, rows: int, layout: Layout) -> Part | None:
    if _count(text, layout.separator) != rows * (len(layout.header.names) - 1):
        return None
    quotes = text.count(b'"') if b'"' in text else 0  # to look for one is many times faster than to count them
    if quotes % 2:
        return None
    if quotes:  # no separator stands between quotes, or there would be more of them
        text = text.replace(b'"', b"")
    table = _read_text(text, layout, {})
    if table is None:  # some programs write 2.0 for a whole number
        table = _read_text(text, layout, {column.name: pl.Float64() for column in layout.kept if column.is_whole})
    if table is None or table.height != rows:
        return None
    table, keyless = with_keys(table, layout.keys, [column for _, column in layout.others])
    is_other, others = other_rows(table, layout)
    table = (table.filter(~is_other) if others else table).select([*layout.schema])
    blank = [column.name for column in layout.kept if column.may_be_blank and column.type in FLOATS]
    table = table.with_columns(pl.col(blank).fill_nan(None)) if blank else table
    if _breaks_rules(table, layout):
        return None
    return Part(table, others=others + keyless, styles=large(table, layout.groupable))


def _without_blank_ends(text: bytes) -> bytes:
    """Returns the text without blank lines around it; a copy only where there are any."""
    is_clean = text[:1] not in (b"\r", b"\n") and not text.endswith((b"\n\n", b"\n\r\n", b"\r\r\n", b"\r"))
    return text if is_clean else text.strip(b"\r\n")


def _count(text: bytes, letter: bytes) -> int:
    """Returns how often a letter occurs; `bytes.count` takes three times as long, and other threads wait for it."""
    letters = np.frombuffer(text, np.uint8)
    parts = (letters[start : start + BLOCK] for start in range(0, len(letters), BLOCK))
    return sum(int(np.count_nonzero(part == ord(letter))) for part in parts)


def _read_text(text: bytes, layout: Layout, types: dict[str, Any]) -> pl.DataFrame | None:
    if text.startswith(PACKED):
        return None
    names = [f"{index}" for index in range(len(layout.header.names))]
    schema: dict[str, Any] = dict.fromkeys(names, pl.String())
    schema |= {names[index]: types.get(column.name, column.type) for index, column in layout.wanted}
    try:
        table = pl.read_csv(
            io.BytesIO(text),
            has_header=False,
            separator=layout.header.separator,
            quote_char=None,
            columns=[index for index, _ in layout.wanted],
            schema=schema,
        )
        table = table.select(pl.col(names[index]).alias(column.name) for index, column in layout.wanted)
        if not types:
            return table
        whole = table.select((pl.col(name) == pl.col(name).round()).all() for name in types).row(0)
        return table.cast(pl.Schema(layout.schema)) if all(whole) else None
    except pl.exceptions.PolarsError:
        return None


def _breaks_rules(table: pl.DataFrame, layout: Layout) -> bool:
    """Returns whether a cell is blank, not finite or out of range where it must not be."""
    checks = []
    for column in layout.kept:
        cell = pl.col(column.name)
        if not column.may_be_blank:
            checks.append(cell.has_nulls())
        if column.is_text:  # a cell that is blank or has spaces around it
            checks.append(cell.unique().cast(pl.String).str.contains(r"^$|^\s|\s$").any())
        if column.type in FLOATS:
            checks.append(~cell.sum().is_finite())  # a sum too large to be finite only leads to the careful path
        if not column.is_text:
            checks.append((cell.min() < column.low) | (cell.max() > column.high))
        if column.among:
            checks.append(~cell.is_in(column.among).all())
    found = table.select(check.fill_null(False).alias(f"{index}") for index, check in enumerate(checks))
    return any(found.row(0))
