"""Ids of a table that stand for no vehicle: words as `nan` and `None`, and -1 among ids that are not below zero."""

from collections.abc import Sequence
from dataclasses import replace

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.readers.plain.mapping import TableMapping
from rampcast.formats.steps.vehicles import without_rows
from rampcast.formats.tables.columns import SHOWN, Rows
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows

RARE = 0.1  # share of the ids, of which those below zero may stand for nobody
NOBODY = ("nan", "none", "null", "na", "n/a", "<na>", "nil")  # as programs write that there is no id


def without_zeros(words: pl.Expr) -> pl.Expr:
    """Returns texts without the ".0" of whole numbers that were floats."""
    return words.str.replace(r"^(-?\d+)\.0+$", "$1").str.strip_chars()


def with_ids(rows: Rows, mapping: TableMapping, bad_rows: BadRows) -> Rows:
    """Returns the rows without those whose id is none, unless the mapping says what is absent.

    Where a row holds several vehicles, the one of no id is absent, as that of an empty cell is.

    Raises:
        FormatError: there is such a row and they are not to be skipped, or there is no other row.
    """
    for column in {entries["vehicle"].column for entries in mapping.vehicles} - {""}:
        is_nobody = _of_nobody(rows.table[column], mapping.absent).fill_null(False)
        if len(mapping.vehicles) > 1:
            nobody = pl.when(~is_nobody).then(pl.col(column)).alias(column)
            rows = replace(rows, table=rows.table.with_columns(nobody))
        elif is_nobody.any():
            rows = _without(rows, column, is_nobody, bad_rows)
    return rows


def _of_nobody(names: pl.Series, absent: Sequence[str]) -> pl.Series:
    """Returns which names are of nobody, by their own look and not as the mapping says.

    They are words for that, or a number below zero where the others are not, or few; where many are, they are ids, as
    of 64 bits with a sign.
    """
    unique = names.unique().drop_nulls()
    words = unique.to_frame("word").select(without_zeros(pl.col("word").cast(pl.String))).to_series()
    unique, words = unique.filter(~words.is_in(absent)), words.filter(~words.is_in(absent))
    is_below = (words.cast(pl.Float64, strict=False) < 0).fill_null(False)
    is_nobody = words.str.to_lowercase().is_in(NOBODY)
    count = is_below.sum()
    if 2 * count < unique.len() and (count == 1 or count <= RARE * unique.len()):
        is_nobody |= is_below
    if not is_nobody.any():
        return pl.repeat(False, len(names), eager=True)
    return names.is_in(unique.filter(is_nobody).implode())


def _without(rows: Rows, column: str, is_nobody: pl.Series, bad_rows: BadRows) -> Rows:
    names, places = rows.table[column], is_nobody.arg_true().head(MOST_LISTED).to_list()
    faults = [
        BadRow(
            rows.file,
            place + 1,
            0,
            f"{column}: expected the id of a vehicle, found '{names[place]!s:.{SHOWN}}', which other programs write "
            "where there is none",
            "row",
        )
        for place in places
    ]
    if bad_rows is BadRows.RAISE or is_nobody.all():
        name = str(names[places[0]])[:SHOWN]
        raise FormatError(
            f"{faults[0]}. Mend the file, say in a mapping that it is nobody (absent = '{name}'), or skip such rows "
            "with --skip-bad-rows (bad_rows=BadRows.SKIP)"
        )
    return without_rows(rows, is_nobody, faults)
