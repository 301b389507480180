"""Lines of a csv in which something is not as expected: those that are good together, the others one by one."""

import csv
import io

import numpy as np
import polars as pl
from jaxtyping import Bool, Int

from rampcast.formats.files.head import BYTE_ORDER_MARK
from rampcast.formats.tables.columns import Column, Layout, read_cell
from rampcast.recording.reading import BadRow

LINE = "number of the line"  # name of a column of our own beside those that are wanted


def parse_carefully(chunk: bytes, layout: Layout, first_line: int) -> tuple[pl.DataFrame, list[BadRow]]:
    """Returns the good rows of a chunk in which not everything is as expected, and the bad rows.

    Args:
        chunk: whole lines.
        layout: of the file.
        first_line: number of the chunk's first line.
    """
    lines = chunk.removeprefix(BYTE_ORDER_MARK).split(b"\n")
    separator = layout.header.separator.encode()
    counts = np.fromiter((line.count(separator) for line in lines), np.int64, len(lines))
    is_plain = (counts == len(layout.header.names) - 1) & ~np.array([b'"' in line for line in lines])
    good, is_good = _plain_rows([lines[index] for index in np.flatnonzero(is_plain)], layout)
    places = np.flatnonzero(is_plain)[is_good]
    is_plain[is_plain] = is_good
    others, read, faults = _one_by_one(lines, np.flatnonzero(~is_plain), layout, first_line)
    if not others.height:
        return good, faults
    both = pl.concat([good, others]).with_columns(pl.Series(LINE, np.concatenate([places, read])))
    return both.sort(LINE).drop(LINE), faults


def _is_blank(cells: list[str], layout: Layout) -> bool:
    """Returns whether a row of the right width has an empty key."""
    is_whole = len(cells) == len(layout.header.names)
    return is_whole and any(column.is_key and not cells[index].strip() for index, column in layout.wanted)


def _read_cells(cells: list[str], layout: Layout) -> tuple[dict[str, float | int | str | None], tuple[int, str] | None]:
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


def _plain_rows(lines: list[bytes], layout: Layout) -> tuple[pl.DataFrame, Bool[np.ndarray, "line"]]:
    """Returns the good rows among lines of the right width without quotes, and which lines these are.

    A line that is not good here may be good when it is read alone.
    """
    if not lines:
        return pl.DataFrame(schema=layout.schema), np.zeros(0, bool)
    names = [f"{index}" for index in range(len(layout.header.names))]
    text = pl.read_csv(
        io.BytesIO(b"\n".join(lines)),
        has_header=False,
        separator=layout.header.separator,
        quote_char=None,
        columns=[index for index, _ in layout.wanted],
        schema=dict.fromkeys(names, pl.String()),
        encoding="utf8-lossy",
    )
    cells = {column: pl.col(names[index]).str.strip_chars() for index, column in layout.wanted}
    found = text.select(
        pl.all_horizontal(_is_good(cell, column) for column, cell in cells.items()).fill_null(False).alias(LINE),
        *(_value(cell, column).alias(column.name) for column, cell in cells.items()),
    )
    return found.filter(pl.col(LINE)).drop(LINE), found[LINE].to_numpy()


def _is_good(cell: pl.Expr, column: Column) -> pl.Expr:
    """Returns an expression that says whether a cell holds what the column wants."""
    is_blank = cell.is_null() | (cell == "")
    if column.is_text:
        return ~is_blank | pl.lit(column.may_be_blank)
    number = cell.cast(pl.Float64, strict=False)
    is_number = (number.is_finite() & number.is_between(column.low, column.largest)).fill_null(False)
    if column.is_whole:
        is_number &= number == number.round()
    return is_number | (is_blank | number.is_nan().fill_null(False) if column.may_be_blank else pl.lit(False))


def _value(cell: pl.Expr, column: Column) -> pl.Expr:
    if column.is_text:
        return pl.when(cell != "").then(cell).cast(column.type)
    number = cell.cast(pl.Float64, strict=False)
    return number.fill_nan(None).cast(column.type, strict=False)


def _cells_of(
    text: str, layout: Layout
) -> tuple[list[str], dict[str, float | int | str | None], tuple[int, str] | None]:
    """Returns the cells of a line, and as `_read_cells` what they hold or what is wrong with it."""
    try:
        cells = next(csv.reader([text], delimiter=layout.header.separator), [])
    except csv.Error as error:  # a line end in the middle of it, a cell of more than 128 KB
        return [], {}, (0, f"expected {len(layout.header.names)} columns, found a line that is no csv: {error}")
    return cells, *_read_cells(cells, layout)


def _one_by_one(
    lines: list[bytes], places: Int[np.ndarray, "odd"], layout: Layout, first_line: int
) -> tuple[pl.DataFrame, list[int], list[BadRow]]:
    """Returns the good rows among the lines at these places, where those stand, and the bad rows."""
    values: dict[str, list[float | int | str | None]] = {column.name: [] for _, column in layout.wanted}
    read, faults = [], []
    for place in places.tolist():
        text = lines[place].rstrip(b"\r").decode("utf-8", "replace").replace("\0", "\ufffd")
        if not text.strip():
            continue
        cells, row, fault = _cells_of(text, layout)
        if _is_blank(cells, layout):
            continue
        if fault:
            faults.append(BadRow(layout.file, first_line + place, *fault))
            continue
        read.append(place)
        for name, value in row.items():
            values[name].append(value)
    return pl.DataFrame(values, schema=layout.schema), read, faults
