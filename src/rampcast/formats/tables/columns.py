"""Columns that a format wants, where they stand in a csv, the rows found, and what is wrong with a cell."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head, Header, plain
from rampcast.formats.tables.thousands import without_separators
from rampcast.recording.reading import BadRow, ReadReport

SHOWN = 40  # letters of a bad cell that a message shows
MOST_NAMES = 40  # of columns that a message shows
ALONE = 5  # bad rows with no good one beyond which the column is another than the format's
OF_ALL = "Mend the column, or say what it is with --mapping (docs/formats/plain.md)"
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
        of_others: what a row is of whose key is empty and this cell is not, as "person"; such rows are counted and left
            out, and so is the column.
        among: the only numbers believed; () where all in the range are.
        unknown: what a message says of any other; {} stands for it.
        only: the text, as `alike` gives it, of rows that are wanted; those with another one are counted and left out,
            and so is the column.
    """

    name: str
    spellings: tuple[str, ...]
    type: Any = field(default_factory=pl.Float64)  # a pl.DataType, which beartype cannot check
    low: float | int = -math.inf
    high: float | int = math.inf
    optional: bool = False
    may_be_blank: bool = False
    is_key: bool = False
    of_others: str = ""
    among: tuple[int, ...] = ()
    unknown: str = ""
    only: str | None = None

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

    def other(self, text: str | None) -> str:
        """Returns the text of a row that is not wanted, as it is compared; "" of one that is or has none."""
        short = (text or "").strip(' "').lower()
        return "" if alike(short) == self.only else short

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
        others: number of rows that are not wanted (`Column.only`), by the text that says so.
        grouped: how many numbers had thousands separators.
    """

    file: str
    table: pl.DataFrame
    faults: tuple[BadRow, ...] = ()
    faults_counted: int = 0
    others: Mapping[str, int] = field(default_factory=dict)
    grouped: int = 0

    def report(self, form: str) -> ReadReport:
        """Returns what reading this file found; `form` says in words what kind of file it is."""
        others = sum(self.others.values())
        return ReadReport(
            files=(self.file,),
            forms=(form,),
            rows_read=self.table.height + self.faults_counted + others,
            rows_other_location=others,
            rows_skipped=self.faults_counted,
            skipped=self.faults,
            grouped_numbers=self.grouped,
        )


@dataclass(frozen=True)
class Part:
    """The rows of a part of a csv.

    Attributes:
        table: the good rows.
        faults: the bad rows.
        others: number of rows that are not wanted, by the text that says so.
        styles: whether a column has thousands separators, of columns with numbers large enough to tell.
        grouped: how many numbers have some.
    """

    table: pl.DataFrame
    faults: Sequence[BadRow] = ()
    others: Mapping[str, int] = field(default_factory=dict)
    styles: Mapping[str, bool] = field(default_factory=dict)
    grouped: int = 0


@dataclass(frozen=True)
class Layout:
    """Where the wanted columns stand in a csv: (index, column) in the file's order.

    Attributes:
        file: its name for messages.
        header: of the file.
        wanted: the columns and where they stand.
        may_group: whether numbers may have thousands separators.
    """

    file: str
    header: Header
    wanted: tuple[tuple[int, Column], ...]
    may_group: bool = True

    @cached_property
    def separator(self) -> bytes:
        """Returns what stands between two columns."""
        return self.header.separator.encode()

    @cached_property
    def kept(self) -> tuple[Column, ...]:
        """Returns the wanted columns but those that only say which rows are."""
        return tuple(column for _, column in self.wanted if column.only is None and not column.of_others)

    @cached_property
    def choosing(self) -> tuple[int, Column] | None:
        """Returns the column that says which rows are wanted, and where it stands; None if all are."""
        return next((pair for pair in self.wanted if pair[1].only is not None), None)

    @property
    def schema(self) -> dict[str, Any]:
        """Returns our names of the columns to keep and their types."""
        return {column.name: column.type for column in self.kept}

    @cached_property
    def groupable(self) -> list[str]:
        """Returns our names of the columns that may have thousands separators."""
        return [column.name for column in self.kept if not column.is_text and self.may_group]

    @property
    def style(self) -> bool | None:
        """Returns whether columns of which no number has told have thousands separators; None where none can tell."""
        return False if self.may_group or self.separator == b" " else None

    @cached_property
    def others(self) -> list[tuple[int, Column]]:
        """Returns the columns that say what a row is of whose key is empty, and where they stand."""
        return [pair for pair in self.wanted if pair[1].of_others]

    @property
    def keys(self) -> list[str]:
        """Returns our names of the columns without which a row says nothing."""
        return [column.name for _, column in self.wanted if column.is_key]


def alike(text: str) -> str:
    """Returns a name as names of places are compared: `I-80`, `i80` and "I 80" are one."""
    return "".join(letter for letter in text.lower() if letter not in " -_")


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


def advice(fault: BadRow, alike: int = 0) -> str:
    """Returns what is wrong with a row, and what to do.

    Args:
        fault: the row.
        alike: how many rows are bad where no good one was read.
    """
    if alike > ALONE:
        return f"{fault}. None of the first {alike:,} rows can be read, so to skip them leaves nothing. {OF_ALL}"
    return f"{fault}. Mend the file, or skip such rows with --skip-bad-rows (bad_rows=BadRows.SKIP)"


def other_rows(table: pl.DataFrame, layout: Layout) -> tuple[pl.Series, Counter[str]]:
    """Returns which rows are not wanted, and how many they are by the text that says so."""
    counts: Counter[str] = Counter()
    if layout.choosing is None:
        return pl.repeat(False, table.height, eager=True), counts
    _, column = layout.choosing
    unwanted = []
    for text, count in table[column.name].value_counts().iter_rows():
        if column.other(text):
            unwanted.append(text)
            counts[column.other(text)] += count
    return table[column.name].is_in(unwanted).fill_null(False), counts


def with_keys(table: pl.DataFrame, keys: Sequence[str], others: Sequence[Column]) -> tuple[pl.DataFrame, Counter[str]]:
    """Returns the rows whose keys are there, and of how many others what they are is told, by that."""
    if not keys:
        return table, Counter()
    kept = table.drop_nulls(keys)
    if kept.height == table.height or not others:
        return kept, Counter()
    lost = table.filter(pl.any_horizontal(pl.col(name).is_null() for name in keys))
    counts = lost.select((pl.col(one.name).cast(pl.String).fill_null("") != "").sum() for one in others).row(0)
    return kept, Counter({one.of_others: count for one, count in zip(others, counts, strict=True) if count})


def read_cell(cell: str, column: Column, is_grouped: bool | None = False) -> tuple[float | int | str | None, str]:
    """Returns the value in a cell and "", or None and what is wrong with it.

    Args:
        cell: without spaces around it.
        column: what is wanted of it.
        is_grouped: whether large numbers of the column have thousands separators; None where nothing can tell.
    """
    shown = f"'{cell[:SHOWN]}'"
    if not cell or (column.may_be_blank and cell.lower() == "nan" and not column.is_text):
        wanted = "text" if column.is_text else "a number"
        return None, "" if column.may_be_blank else f"expected {wanted}, the cell is empty"
    if column.is_text:
        return cell, ""
    cell, reason = without_separators(cell, is_grouped)
    if reason:
        return None, reason
    try:
        value = float(cell) if "_" not in cell else math.nan
    except ValueError:
        return None, f"expected a number, found {shown}"
    if not math.isfinite(value):
        return None, f"expected a finite number, found {shown}"
    if not column.low <= value <= column.largest:
        return None, f"expected {column.range}, found {shown}"
    if column.is_whole and value != int(value):
        return None, f"expected a whole number, found {shown}"
    if column.among and value not in column.among:
        return None, column.unknown.replace("{}", shown)
    return int(value) if column.is_whole else value, ""
