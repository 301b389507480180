"""Columns that a format wants, where they stand in a csv, the rows found, and what is wrong with a cell."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head, Header, plain
from rampcast.recording.reading import BadRow, ReadReport

SHOWN = 40  # letters of a bad cell that a message shows
MOST_NAMES = 40  # of columns that a message shows
WHOLE = {pl.Int8: 2**7 - 1, pl.Int16: 2**15 - 1, pl.Int32: 2**31 - 1, pl.Int64: 2**63 - 1}  # and their largest


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
        is_key: whether a row in which this cell is empty says nothing and is left out, whatever its other cells are.
    """

    name: str
    spellings: tuple[str, ...]
    type: Any = field(default_factory=pl.Float64)  # a pl.DataType, which beartype cannot check
    low: float | int = -math.inf
    high: float | int = math.inf
    optional: bool = False
    may_be_blank: bool = False
    is_key: bool = False

    @cached_property
    def is_text(self) -> bool:
        """Returns whether its cells are text."""
        return self.type in (pl.String, pl.Categorical)

    @cached_property
    def is_whole(self) -> bool:
        """Returns whether its cells are whole numbers."""
        return self.type in tuple(WHOLE)

    @cached_property
    def largest(self) -> float | int:
        """Returns the largest number believed and of its type."""
        return min([self.high, *(largest for kind, largest in WHOLE.items() if self.type == kind)])

    @property
    def range(self) -> str:
        """Returns in words which numbers are believed; "" where all are."""
        low, high = f"{self.low:,.15g}", f"{self.largest:,.15g}"
        if math.isinf(self.low):
            return "" if math.isinf(self.largest) else f"{high} or less"
        return f"{low} or more" if math.isinf(self.largest) else f"{low} to {high}"


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
class Layout:
    """Where the wanted columns stand in a csv: (index, column) in the file's order."""

    file: str
    header: Header
    wanted: tuple[tuple[int, Column], ...]

    @property
    def schema(self) -> dict[str, Any]:
        """Returns our names of the wanted columns and their types."""
        return {column.name: column.type for _, column in self.wanted}

    @property
    def keys(self) -> list[str]:
        """Returns our names of the columns without which a row says nothing."""
        return [column.name for _, column in self.wanted if column.is_key]


def place_of(column: Column, names: Sequence[str], where: str) -> int | None:
    """Returns the place of a column among a table's names, counted from 0; None if it is not there.

    Args:
        column: the column, of whose spellings the first that is there counts.
        names: of the table's columns.
        where: the file and line, for the message.

    Raises:
        FormatError: several columns have its name.
    """
    for spelling in column.spellings:
        same = [index for index, name in enumerate(names) if plain(name) == plain(spelling)]
        exact = [index for index in same if names[index] == spelling]
        if len(same) > 1 and len(exact) != 1:
            numbers = " and ".join(str(index + 1) for index in same)
            raise FormatError(
                f"{where}: the columns {numbers} are both called '{names[same[0]][:SHOWN]}'; which one counts? "
                "Remove or rename the other"
            )
        if same:
            return exact[0] if exact else same[0]
    return None


def missing_column(head: Head, columns: Sequence[Column]) -> str | None:
    """Returns the first thing a file lacks to have these columns, in words; None if it has them all."""
    if not head.names:
        return "no header that names columns"
    found = {plain(name) for name in head.names}
    for column in columns:
        if not column.optional and not found.intersection(map(plain, column.spellings)):
            return f"no column '{column.spellings[0]}'"
    return None


def missing(column: Column, names: Sequence[str]) -> str:
    """Returns a message for a file that lacks a column and has those of the names, and what to do."""
    more = f" and {len(names) - MOST_NAMES:,} more" if len(names) > MOST_NAMES else ""
    shown = ", ".join(name[:SHOWN] for name in names[:MOST_NAMES])
    return (
        f"no column '{column.spellings[0]}'; the columns are {shown}{more}. Name it so in the file, or describe the "
        "columns with --mapping (docs/formats/plain.md)"
    )


def advice(fault: BadRow) -> str:
    """Returns what is wrong with a row, and what to do."""
    return f"{fault}. Mend the file, or skip such rows with --skip-bad-rows (bad_rows=BadRows.SKIP)"


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
    if not column.low <= value <= column.largest:
        return None, f"expected {column.range}, found {shown}"
    if column.is_whole:
        return int(value), "" if value == int(value) else f"expected a whole number, found {shown}"
    return value, ""
