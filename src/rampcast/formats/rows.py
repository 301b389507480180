"""Rows of tables with named columns, csv or parquet: a fast path, and a careful one that finds each bad row.

A format lists the columns it wants; what is not listed is not read. Files are read in chunks, so a whole text is never
in memory; a chunk in which anything is not as expected is read again piece by piece, and the bad pieces line by line.
"""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.head import BYTE_ORDER_MARK, Head, Header, find_header, look, plain
from rampcast.formats.report import MOST_LISTED, BadRow, BadRows, ReadReport
from rampcast.formats.sources import open_source, parse_ahead, read_chunks

PIECE = 32 << 10  # [bytes] of a chunk with a fault that are read again together
SHOWN = 40  # letters of a bad cell that a message shows
WHOLE = (pl.Int8, pl.Int16, pl.Int32, pl.Int64)


@dataclass(frozen=True)
class Column:
    """A column that a format wants.

    Attributes:
        name: ours.
        spellings: how files name it; compared without regard to case, hyphens and underscores.
        type: of the values; whole numbers, floats, or `pl.Categorical` or `pl.String` for text.
        low, high: the least and the largest number believed.
        optional: whether a file may lack it.
        may_be_blank: whether a cell may be empty (or NaN); it reads as null.
    """

    name: str
    spellings: tuple[str, ...]
    type: Any = field(default_factory=pl.Float64)  # a pl.DataType, which beartype cannot check
    low: float | int = -math.inf
    high: float | int = math.inf
    optional: bool = False
    may_be_blank: bool = False

    @property
    def is_text(self) -> bool:
        """Returns whether its cells are text."""
        return self.type in (pl.String, pl.Categorical)

    @property
    def is_whole(self) -> bool:
        """Returns whether its cells are whole numbers."""
        return self.type in WHOLE


@dataclass(frozen=True)
class Rows:
    """The good rows of one file, with the columns that were wanted and found, and the bad ones.

    Attributes:
        file: its name for messages.
        table: the good rows; a column that is optional and absent is absent here.
        faults: the first 100 bad rows.
        faults_counted: how many there were.
    """

    file: str
    table: pl.DataFrame
    faults: tuple[BadRow, ...] = ()
    faults_counted: int = 0

    def report(self, form: str) -> ReadReport:
        """Returns what reading this file found; `form` says in words what kind of file it is."""
        return ReadReport(
            files=(self.file,),
            forms=(form,),
            rows_read=self.table.height + self.faults_counted,
            rows_skipped=self.faults_counted,
            skipped=self.faults,
        )


@dataclass(frozen=True)
class _Layout:
    """Where the wanted columns stand in a csv: (index, column) in the file's order."""

    file: str
    header: Header
    wanted: tuple[tuple[int, Column], ...]

    @property
    def schema(self) -> dict[str, Any]:
        return {column.name: column.type for _, column in self.wanted}


def missing_column(head: Head, columns: Sequence[Column]) -> str | None:
    """Returns the first thing a file lacks to have these columns, in words; None if it has them all."""
    if not head.names:
        return "no header that names columns"
    found = {plain(name) for name in head.names}
    for column in columns:
        if not column.optional and not found.intersection(map(plain, column.spellings)):
            return f"no column '{column.spellings[0]}'"
    return None


def read_rows(path: Path, columns: Sequence[Column], *, bad_rows: BadRows = BadRows.RAISE) -> Rows:
    """Returns the rows of a csv (plain, or in a .gz or .zip) or parquet file.

    Raises:
        FormatError: the file is not there, lacks a column or any row, or has a bad row and those are not to be skipped.
    """
    head = look(path)
    rows = (_read_parquet if head.is_parquet else _read_csv)(path, columns, bad_rows)
    if not rows.table.height and rows.faults:
        raise FormatError(f"{rows.file}: none of its {rows.faults_counted:,} rows can be read. {rows.faults[0]}")
    if not rows.table.height:
        raise FormatError(f"{rows.file}: the file has a header but no rows; get the file again")
    return rows


def _read_csv(path: Path, columns: Sequence[Column], bad_rows: BadRows) -> Rows:
    with open_source(path) as (name, stream):
        chunks = read_chunks(name, stream)
        first = next(chunks, b"")
        layout = _layout(name, find_header(first), columns)
        body = _skip(first, layout)
        parts: list[pl.DataFrame] = []
        faults: list[BadRow] = []
        line, counted = layout.header.lines + 1, 0
        for chunk, found in parse_ahead(chain([body], chunks), lambda chunk: _parse(chunk, layout)):
            table, bad = (found, []) if found is not None else _parse_pieces(chunk, layout, line)
            if bad and bad_rows is BadRows.RAISE:
                raise FormatError(_advice(bad[0]))
            parts.append(table)
            faults.extend(bad[: MOST_LISTED - len(faults)])
            counted += len(bad)
            line += chunk.count(b"\n")
    return Rows(name, pl.concat(parts), tuple(faults), counted)


def _skip(chunk: bytes, layout: _Layout) -> bytes:
    start = 0
    for _ in range(layout.header.lines):
        start = chunk.find(b"\n", start) + 1 or len(chunk)
    return chunk[start:]


def _advice(fault: BadRow) -> str:
    return f"{fault}. Mend the file, or skip such rows with --skip-bad-rows (bad_rows=BadRows.SKIP)"


def _layout(name: str, header: Header | None, columns: Sequence[Column]) -> _Layout:
    if header is None:
        names = ", ".join(column.spellings[0] for column in columns if not column.optional)
        raise FormatError(f"{name}: expected a csv whose first line names its columns, among them {names}")
    places: dict[str, int] = {}
    for index, spelling in enumerate(header.names):
        places.setdefault(plain(spelling), index)
    wanted = []
    for column in columns:
        index = next((places[plain(one)] for one in column.spellings if plain(one) in places), -1)
        if index < 0 and not column.optional:
            raise FormatError(
                f"{name}, line {header.lines}: no column '{column.spellings[0]}'; the columns are "
                f"{', '.join(header.names)}"
            )
        if index >= 0:
            wanted.append((index, column))
    return _Layout(name, header, tuple(sorted(wanted, key=lambda pair: pair[0])))


def _parse(chunk: bytes, layout: _Layout) -> pl.DataFrame | None:
    """Returns the rows of a chunk of whole lines, or None if anything in it is not as expected."""
    text = chunk.removeprefix(BYTE_ORDER_MARK).strip(b"\r\n")
    if not text:
        return pl.DataFrame(schema=layout.schema)
    rows = text.count(b"\n") + 1
    if text.count(layout.header.separator.encode()) != rows * (len(layout.header.names) - 1):
        return None
    if b'"' in text:  # no separator stands between quotes, or there would be more of them
        text = text.replace(b'"', b"")
    table = _read_text(text, layout, {})
    if table is None:  # some programs write 2.0 for a whole number
        table = _read_text(text, layout, {column.name: pl.Float64() for _, column in layout.wanted if column.is_whole})
    return table if table is not None and table.height == rows and not _breaks_rules(table, layout) else None


def _read_text(text: bytes, layout: _Layout, types: dict[str, Any]) -> pl.DataFrame | None:
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


def _breaks_rules(table: pl.DataFrame, layout: _Layout) -> bool:
    """Returns whether a cell is blank, not finite or out of range where it must not be."""
    checks = []
    for _, column in layout.wanted:
        cell = pl.col(column.name)
        if not column.may_be_blank:
            checks.append(cell.has_nulls() if not column.is_text else (cell.has_nulls() | (cell == "").any()))
        if column.type in (pl.Float32, pl.Float64):
            checks.append((~cell.is_finite()).any())
        if not column.is_text:
            checks.append((cell.min() < column.low) | (cell.max() > column.high))
    found = table.select(check.fill_null(False).alias(f"{index}") for index, check in enumerate(checks))
    return any(found.row(0))


def _parse_pieces(chunk: bytes, layout: _Layout, first_line: int) -> tuple[pl.DataFrame, list[BadRow]]:
    """Returns the good rows of a chunk with a fault in it, and the bad rows."""
    parts, faults, line = [pl.DataFrame(schema=layout.schema)], [], first_line
    for piece in _pieces(chunk):
        table = _parse(piece, layout)
        if table is None:
            table, bad = _parse_lines(piece, layout, line)
            faults.extend(bad)
        parts.append(table)
        line += piece.count(b"\n")
    return pl.concat(parts), faults


def _pieces(chunk: bytes) -> Iterator[bytes]:
    start = 0
    while start < len(chunk):
        end = chunk.find(b"\n", start + PIECE) + 1 or len(chunk)
        yield chunk[start:end]
        start = end


def _parse_lines(piece: bytes, layout: _Layout, first_line: int) -> tuple[pl.DataFrame, list[BadRow]]:
    values: dict[str, list[float | int | str | None]] = {column.name: [] for _, column in layout.wanted}
    faults = []
    for number, line in enumerate(piece.removeprefix(BYTE_ORDER_MARK).split(b"\n"), start=first_line):
        text = line.rstrip(b"\r").decode("utf-8", "replace").replace("\0", "\ufffd")
        if not text.strip():
            continue
        cells = next(csv.reader([text], delimiter=layout.header.separator), [])
        row, fault = _read_cells(cells, layout)
        if fault:
            faults.append(BadRow(layout.file, number, *fault))
            continue
        for name, value in row.items():
            values[name].append(value)
    return pl.DataFrame(values, schema=layout.schema), faults


def _read_cells(
    cells: list[str], layout: _Layout
) -> tuple[dict[str, float | int | str | None], tuple[int, str] | None]:
    """Returns the values of a row by our names, or the column (from 1, 0 the whole row) and reason of its fault."""
    expected = len(layout.header.names)
    if len(cells) != expected:
        what = "the row is cut off" if len(cells) < expected else "a separator too many"
        return {}, (0, f"expected {expected} columns, found {len(cells)}: {what}")
    row: dict[str, float | int | str | None] = {}
    for index, column in layout.wanted:
        row[column.name], reason = read_cell(cells[index].strip(), column)
        if reason:
            return {}, (index + 1, f"{layout.header.names[index]}: {reason}")
    return row, None


def read_cell(cell: str, column: Column) -> tuple[float | int | str | None, str]:
    """Returns the value in a cell and "", or None and what is wrong with it."""
    shown = f"'{cell[:SHOWN]}'"
    if not cell or (column.may_be_blank and cell.lower() == "nan" and not column.is_text):
        wanted = "text" if column.is_text else "a number"
        return None, "" if column.may_be_blank else f"expected {wanted}, the cell is empty"
    if column.is_text:
        return cell, ""
    try:
        value = float(cell) if "_" not in cell else math.nan
    except ValueError:
        return None, f"expected a number, found {shown}"
    if not math.isfinite(value):
        return None, f"expected a finite number, found {shown}"
    if not column.low <= value <= column.high:
        return None, f"expected {column.low:,g} to {column.high:,g}, found {shown}"
    if column.is_whole:
        return int(value), "" if value == int(value) else f"expected a whole number, found {shown}"
    return value, ""


def _read_parquet(path: Path, columns: Sequence[Column], bad_rows: BadRows) -> Rows:
    head = look(path)
    places = {plain(name): name for name in reversed(head.names)}
    chosen: dict[str, Column] = {}
    for column in columns:
        name = next((places[plain(one)] for one in column.spellings if plain(one) in places), None)
        if name is None and not column.optional:
            raise FormatError(f"{path}: no column '{column.spellings[0]}'; the columns are {', '.join(head.names)}")
        if name is not None:
            chosen[name] = column
    try:
        raw = pl.read_parquet(path, columns=list(chosen))
    except (pl.exceptions.PolarsError, OSError) as error:
        raise FormatError(f"{path}: a damaged parquet file ({error}); get the file again") from error
    reasons = pl.concat_list(
        _fault_of(name, column, raw.schema[name]) for name, column in chosen.items()
    ).list.drop_nulls()
    faults = raw.select(reasons.list.first().alias("reason")).with_row_index("row", 1).drop_nulls()
    listed = tuple(BadRow(str(path), row, 0, reason, "row") for row, reason in faults.head(MOST_LISTED).iter_rows())
    if listed and bad_rows is BadRows.RAISE:
        raise FormatError(_advice(listed[0]))
    good = raw.with_row_index("row", 1).join(faults, on="row", how="anti") if listed else raw
    table = good.select(
        pl.col(name).cast(column.type, strict=False).alias(column.name) for name, column in chosen.items()
    )
    return Rows(str(path), table, listed, faults.height)


def _fault_of(name: str, column: Column, found: Any) -> pl.Expr:
    """Returns an expression that says what is wrong with a cell of a parquet file; null if nothing is."""
    cell = pl.col(name)
    shown = cell.cast(pl.String, strict=False).fill_null("nothing").str.slice(0, SHOWN)
    if column.is_text:
        wrong = cell.is_null() if not column.may_be_blank else pl.lit(False)
        return pl.when(wrong).then(pl.lit(f"{name}: expected text, the cell is empty"))
    if found.is_nested():
        return pl.lit(f"{name}: expected a number, found a list")
    number = cell.cast(pl.Float64, strict=False)
    blank = cell.is_null() | (number.is_nan() if found.is_float() else pl.lit(False))
    good = number.is_finite() & number.is_between(column.low, column.high)
    if column.is_whole:
        good &= number == number.round()
    wrong = pl.when(blank).then(pl.lit(not column.may_be_blank)).otherwise(~good.fill_null(False))
    kind = "a whole number" if column.is_whole else "a number"
    return pl.when(wrong).then(
        pl.format(f"{name}: expected {kind} from {column.low:g} to {column.high:g}, found '{{}}'", shown)
    )
