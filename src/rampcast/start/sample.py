"""The first rows of a table whose columns nobody has described, as numbers where they are numbers."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import SIZE, Head
from rampcast.formats.files.sources import open_source
from rampcast.formats.tables.rows_careful import ABOVE
from rampcast.formats.tables.thousands import GROUPED, has_decimal_commas, has_decimal_points, in_doubt

BYTES = 24 << 20  # of a csv that are looked at: some 300,000 rows
ROWS = 300_000


@dataclass(frozen=True)
class Sample:
    """The first rows of a table.

    Attributes:
        name: of the file, for messages.
        table: its columns; text where a cell is no number.
        separator: between two columns of a csv; "" of another file.
        decimal_comma: whether its numbers have one.
    """

    name: str
    table: pl.DataFrame
    separator: str = ""
    decimal_comma: bool = False


def sample_of_head(head: Head) -> Sample:
    """Returns the first rows of a csv, a parquet file or a table in memory.

    Raises:
        FormatError: it is no table with a line of names, or has no rows.
    """
    if head.table is not None:
        return Sample(head.name, head.table.head(ROWS))
    if head.types is not None:
        return Sample(head.name, pl.scan_parquet(head.path).head(ROWS).collect())
    if head.header is not None and head.text.count(b"\n") < head.header.lines and len(head.text) >= SIZE:
        raise FormatError(
            f"{head.name}: its first line has more than {SIZE:,} letters, expected the names of columns; leave out "
            "those that tell nothing of vehicles"
        )
    if head.header is None:
        raise FormatError(
            f"{head.name}: this is no table whose first line names its columns. Put one before the numbers, "
            "as id,time,x,y, and call the same command again"
        )
    with open_source(head.path) as (_, stream):
        text = stream.read(BYTES)
    text = text[: text.rfind(b"\n") + 1] or text
    rows = b"".join(text.split(b"\n", head.header.lines)[head.header.lines :])
    if not rows.strip():
        raise FormatError(f"{head.name}: the file has a header but no rows; get the file again")
    comma = has_decimal_commas(head)
    table = pl.read_csv(
        io.BytesIO(ABOVE + b"\n" + rows), skip_lines=1, separator=head.header.separator, has_header=False,
        infer_schema=False, truncate_ragged_lines=True, encoding="utf8-lossy",
    )  # fmt: skip
    table = _named(head.name, table, head.header.names)
    if not comma and not has_decimal_points(head):
        _check_commas(head.name, table)
    return Sample(head.name, table.select(_typed(column, comma) for column in table), head.header.separator, comma)


def _named(name: str, table: pl.DataFrame, names: Sequence[str]) -> pl.DataFrame:
    """Returns a table with the names of its columns; cells behind the last name may be empty.

    Raises:
        FormatError: they are not.
    """
    count = len(names)
    if any((column.fill_null("").str.strip_chars() != "").any() for column in table[:, count:]):
        raise FormatError(
            f"{name}: its rows have up to {table.width:,} cells, its first line names {count:,}. If a row is a vehicle "
            "with all its moments, write a row for each vehicle and moment, as id,time,x,y"
        )
    return table[:, :count].rename(dict(zip(table.columns, names, strict=False)))


def _check_commas(name: str, table: pl.DataFrame) -> None:
    """Raises if numbers of a table have commas that may part thousands or decimals."""
    for column in table:
        cells = column.str.strip_chars(' "')
        doubtful = cells.filter(cells.str.contains(GROUPED))
        if doubtful.len():
            raise FormatError(f"{name}: {column.name}: {in_doubt(doubtful[0])}")


def _typed(column: pl.Series, decimal_comma: bool) -> pl.Series:
    """Returns a column as numbers where all cells are, but for a few that are empty."""
    text = column.str.strip_chars(' "')
    text = text.str.replace(",", ".", literal=True) if decimal_comma else text
    empty = text.is_null() | text.str.to_lowercase().is_in(["", "nan", "na", "null", "none"])
    is_grouped = text.str.contains(GROUPED).fill_null(False)
    numbers = text.str.replace_all(",", "", literal=True).zip_with(is_grouped, text).cast(pl.Float64, strict=False)
    return numbers if (numbers.is_null() & ~empty).mean() < 0.01 and not empty.all() else text  # type: ignore[operator]
