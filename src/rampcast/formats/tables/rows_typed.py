"""Rows of tables whose columns have types, whatever these are: parquet files, and tables in memory."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head
from rampcast.formats.files.records import records_table
from rampcast.formats.tables.columns import SHOWN, Column, Rows, advice, missing, place_of, with_keys
from rampcast.recording.parquet import read_table
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows

TEXT = (pl.String, pl.Categorical, pl.Enum)
ROW = "number of the row"  # name of a column of our own beside those of the table


def read_typed(head: Head, columns: Sequence[Column], bad_rows: BadRows) -> Rows:
    """Returns the rows of a parquet file or a table in memory.

    Raises:
        FormatError: the file is damaged, it lacks a column, or has a bad row and those are not to be skipped.
    """
    chosen: dict[str, Column] = {}
    for column in columns:
        place = place_of(column, head.names, head.name)
        if place is None and not column.optional:
            raise FormatError(f"{head.name}: {missing(column, head.names)}")
        if place is not None:
            chosen[head.names[place]] = column
    raw, others = _wanted(_table(head, list(chosen)).with_row_index(ROW, 1), chosen)
    keys = [name for name, column in chosen.items() if column.is_key]
    beside = [replace(column, name=name) for name, column in chosen.items() if column.of_others]
    raw, keyless = with_keys(raw, keys, beside)
    reasons = pl.concat_list(
        _fault_of(name, column, raw.schema[name]) for name, column in chosen.items()
    ).list.drop_nulls()
    faults = raw.select(ROW, reasons.list.first().alias("reason")).drop_nulls()
    listed = tuple(BadRow(head.name, row, 0, reason, "row") for row, reason in faults.head(MOST_LISTED).iter_rows())
    if listed and bad_rows is BadRows.RAISE:
        raise FormatError(advice(listed[0], faults.height if faults.height == raw.height else 0))
    good = raw.join(faults, on=ROW, how="anti") if listed else raw
    table = good.select(
        _cell(name, column, raw.schema[name]).cast(column.type, strict=False).alias(column.name)
        for name, column in chosen.items()
        if column.only is None and not column.of_others
    )
    return Rows(head.name, table, listed, faults.height, others | keyless)


def _table(head: Head, names: list[str]) -> pl.DataFrame:
    if head.table is not None:
        return head.table.select(names)
    return records_table(head.path).select(names) if head.records else read_table(head.path, names)


def _wanted(raw: pl.DataFrame, chosen: dict[str, Column]) -> tuple[pl.DataFrame, dict[str, int]]:
    """Returns the rows that are wanted, and how many are not, by the text that says so."""
    for name, column in chosen.items():
        if column.only is not None and _is_simple(raw.schema[name]):
            texts = raw[name].cast(pl.String)
            unwanted = {text: column.other(text) for text in texts.unique() if column.other(text)}
            is_other = texts.is_in(list(unwanted)).fill_null(False)
            counts = texts.filter(is_other).value_counts().rows()
            return raw.filter(~is_other), {unwanted[text]: count for text, count in counts}
    return raw, {}


def _cell(name: str, column: Column, found: Any) -> pl.Expr:
    """Returns a cell; polars makes categories of text alone, and no numbers of what has parts."""
    if not _is_simple(found):
        return pl.lit(None)
    if column.is_text:
        return pl.col(name).cast(pl.String, strict=False)
    return pl.col(name).cast(pl.Float64, strict=False) if found in TEXT and column.is_whole else pl.col(name)


def _is_simple(found: Any) -> bool:
    """Returns whether a type is numbers, times or text: no lists, no bytes."""
    return (
        found.is_numeric() or found.is_temporal() or found in (pl.String, pl.Categorical, pl.Enum, pl.Boolean, pl.Null)
    )


def _fault_of(name: str, column: Column, found: Any) -> pl.Expr:
    """Returns an expression that says what is wrong with a cell; null if nothing is."""
    if not _is_simple(found) or (found == pl.Boolean and not column.is_text):
        return pl.lit(f"{name}: expected {'text' if column.is_text else 'a number'}, found the type {found}")
    cell = pl.col(name)
    shown = cell.cast(pl.String, strict=False).fill_null("nothing").str.slice(0, SHOWN)
    if column.is_text:
        wrong = pl.lit(False) if column.may_be_blank else cell.is_null() | (cell.cast(pl.String, strict=False) == "")
        return pl.when(wrong).then(pl.lit(f"{name}: expected text, the cell is empty"))
    number = cell.cast(pl.Float64, strict=False)
    blank = cell.is_null() | (number.is_nan() if found.is_float() else pl.lit(False))
    good = number.is_finite() & number.is_between(column.low, column.largest)
    if column.is_whole:
        good &= number == number.round()
    wrong = pl.when(blank).then(pl.lit(not column.may_be_blank)).otherwise(~good.fill_null(False))
    kind = ("a whole number" if column.is_whole else "a number") + (f", {column.range}" if column.range else "")
    return pl.when(wrong).then(pl.format(f"{name}: expected {kind}, found '{{}}'", shown))
