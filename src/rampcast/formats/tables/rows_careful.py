"""Lines of a csv in which something is not as expected: those that are good together, the others one by one."""

import csv
import io
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import polars as pl
from jaxtyping import Int

from rampcast.formats.files.head import BYTE_ORDER_MARK
from rampcast.formats.tables.columns import Column, Layout, Part, other_rows, read_cell
from rampcast.formats.tables.thousands import grouped_numbers, number_in, styles_of
from rampcast.recording.reading import BadRow

LINE, GOOD = "number of the line", "is good"  # names of columns of our own beside those that are wanted
ABOVE = b"#"  # a line above a text, or polars takes one that begins as compressed files do for such a file
STAND_IN = b"\x1f"  # for a separator in quotes: a letter that no text has
NUL = "a NUL byte: this part of the file was not written; get the file again"

MORE, FEWER = ": a separator too many, maybe in a number that is not in quotes", ": the row is cut off"

Cells = dict[str, float | int | str | None]  # the values of a row by our names
Fault = tuple[int, str]  # the column (from 1, 0 the whole row) and what is wrong with it


@dataclass
class _Read:
    """What reading lines one by one gave: good rows and where they stand, bad ones, and those that are not wanted."""

    values: dict[str, list[float | int | str | None]]
    places: list[int] = field(default_factory=list)
    faults: list[BadRow] = field(default_factory=list)
    others: Counter[str] = field(default_factory=Counter)


def parse_carefully(chunk: bytes, layout: Layout, first_line: int, styles: Mapping[str, bool]) -> Part:
    """Returns the rows of a chunk in which not everything is as expected.

    Args:
        chunk: whole lines.
        layout: of the file.
        first_line: number of the chunk's first line.
        styles: whether columns have thousands separators, as far as earlier chunks told.
    """
    lines = chunk.removeprefix(BYTE_ORDER_MARK).split(b"\n")
    lines = [b" ".join(line.split()) for line in lines] if layout.separator == b" " else lines
    unquoted, separator = _without_quotes(lines, layout.separator) if b'"' in chunk else lines, layout.separator
    counts = np.fromiter((line.count(separator) for line in unquoted), np.int64, len(lines))
    is_quoted = [b'"' in short or STAND_IN in line for short, line in zip(unquoted, lines, strict=True)]
    is_plain = (counts == len(layout.header.names) - 1) & ~np.array(is_quoted)
    places = np.flatnonzero(is_plain)
    cells = _cells([unquoted[place] for place in places], layout)
    styles = styles_of(cells, layout.groupable) | dict(styles)
    judged = _judged(cells, layout, styles)
    is_other, others = other_rows(cells, layout)
    is_good = judged[GOOD] & ~is_other
    is_odd = np.ones(len(lines), bool)
    is_odd[places[is_good | is_other]] = False
    read = _one_by_one(lines, np.flatnonzero(is_odd), layout, first_line, styles)
    table = judged.filter(is_good).drop(GOOD)
    if read.places:
        both = pl.concat([table, pl.DataFrame(read.values, schema=layout.schema)])
        order = pl.Series(LINE, np.concatenate([places[is_good], read.places]))
        table = both.with_columns(order).sort(LINE).drop(LINE)
    return Part(table, read.faults, read.others + others, styles, grouped_numbers(cells, layout.groupable))


def _without_quotes(lines: list[bytes], separator: bytes) -> list[bytes]:
    """Returns lines with cells that are not in quotes, and stand-ins for separators in these; odd ones as they are."""
    mark = re.escape(separator)
    quoted = re.compile(rb"(?:(?<=" + mark + rb')|^)"([^"]*)"(?=' + mark + rb"|\r?$)")

    def without(line: bytes) -> bytes:
        return quoted.sub(lambda cell: cell[1].replace(separator, STAND_IN), line)

    return [without(line) if b'"' in line and STAND_IN not in line else line for line in lines]


def _cells(lines: list[bytes], layout: Layout) -> pl.DataFrame:
    """Returns the wanted cells of lines of the right width, without spaces around them, as text by our names."""
    if not lines:
        return pl.DataFrame(schema={column.name: pl.String() for _, column in layout.wanted})
    names = [f"{index}" for index in range(len(layout.header.names))]
    text = pl.read_csv(
        io.BytesIO(b"\n".join([ABOVE, *lines])),
        skip_lines=1,
        has_header=False,
        separator=layout.header.separator,
        quote_char=None,
        columns=[index for index, _ in layout.wanted],
        schema=dict.fromkeys(names, pl.String()),
        encoding="utf8-lossy",
    )
    stand_in = STAND_IN.decode()
    return text.select(
        pl.col(names[index])
        .str.replace_all(stand_in, layout.header.separator, literal=True)
        .str.strip_chars()
        .alias(column.name)
        for index, column in layout.wanted
    )


def _judged(cells: pl.DataFrame, layout: Layout, styles: Mapping[str, bool]) -> pl.DataFrame:
    """Returns the values of cells, and which rows are good; one that is not may be good when it is read alone."""
    numbers = {
        column: number_in(pl.col(column.name), styles.get(column.name, False))
        for column in layout.kept
        if not column.is_text
    }
    goods = (_is_good(pl.col(column.name), numbers.get(column), column) for column in layout.kept)
    values = (_value(pl.col(column.name), numbers.get(column), column) for column in layout.kept)
    return cells.select(pl.all_horizontal(*goods).fill_null(False).alias(GOOD), *values)


def _is_good(cell: pl.Expr, number: pl.Expr | None, column: Column) -> pl.Expr:
    """Returns an expression that says whether a cell, and the number in it, is what the column wants."""
    is_blank = cell.is_null() | (cell == "")
    if number is None:
        return ~is_blank | pl.lit(column.may_be_blank)
    is_number = (number.is_finite() & number.is_between(column.low, column.largest)).fill_null(False)
    if column.is_whole:
        is_number &= number == number.round()
    if column.among:
        is_number &= number.is_in([float(one) for one in column.among])
    return is_number | (is_blank | number.is_nan().fill_null(False) if column.may_be_blank else pl.lit(False))


def _value(cell: pl.Expr, number: pl.Expr | None, column: Column) -> pl.Expr:
    if number is None:
        return pl.when(cell != "").then(cell).cast(column.type).alias(column.name)
    return number.fill_nan(None).cast(column.type, strict=False).alias(column.name)


def _one_by_one(
    lines: list[bytes], places: Int[np.ndarray, "odd"], layout: Layout, first_line: int, styles: Mapping[str, bool]
) -> _Read:
    """Returns what the lines at these places hold."""
    found = _Read({column.name: [] for column in layout.kept})
    for place in places.tolist():
        text = lines[place].rstrip(b"\r").decode("utf-8", "replace")
        if not text.strip():
            continue
        try:
            cells = next(csv.reader([text], delimiter=layout.header.separator), [])
        except csv.Error as error:  # a line end in the middle of it, a cell of more than 128 KB
            reason = f"expected {len(layout.header.names)} columns, found a line that is no csv: {error}"
            found.faults.append(BadRow(layout.file, first_line + place, 0, reason))
            continue
        _read_line(cells, place, layout, first_line, styles, found)
    return found


def _read_line(
    cells: list[str], place: int, layout: Layout, first_line: int, styles: Mapping[str, bool], found: _Read
) -> None:
    """Adds what a line holds to what has been found."""
    is_whole = len(cells) == len(layout.header.names)
    if is_whole and any(column.is_key and not cells[index].strip() for index, column in layout.wanted):
        found.others.update(column.of_others for index, column in layout.others if cells[index].strip())
        return  # else it says nothing
    if is_whole and layout.choosing and (other := layout.choosing[1].other(cells[layout.choosing[0]])):
        found.others[other] += 1
        return
    row, fault = _read_cells(cells, layout, styles)
    if fault:
        nul = next((index for index, cell in enumerate(cells) if "\0" in cell), None)
        fault = fault if nul is None else (nul + 1, NUL)
        found.faults.append(BadRow(layout.file, first_line + place, *fault))
        return
    found.places.append(place)
    for name, value in row.items():
        found.values[name].append(value)


def _read_cells(cells: list[str], layout: Layout, styles: Mapping[str, bool]) -> tuple[Cells, Fault | None]:
    """Returns the values of a row, or its first fault."""
    expected = len(layout.header.names)
    if len(cells) != expected:
        return {}, (0, f"expected {expected} columns, found {len(cells)}{MORE if len(cells) > expected else FEWER}")
    row: Cells = {}
    for index, column in layout.wanted:
        if column.only is None and not column.of_others:
            row[column.name], reason = read_cell(cells[index].strip(), column, styles.get(column.name, layout.style))
            if reason:
                return {}, (index + 1, f"{layout.header.names[index]}: {reason}")
    return row, None
