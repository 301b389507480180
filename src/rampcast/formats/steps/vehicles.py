"""What readers of several sources need of vehicles: whole ids, kinds, sizes where they are missing, front centres."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.tables.columns import Rows, advice
from rampcast.formats.tables.thousands import whole_name
from rampcast.recording import columns as c
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows
from rampcast.recording.translation import translated

# Length and width [m] of a vehicle whose source gives none: SUMO's vehicle classes motorcycle, passenger and truck.
TYPICAL_SIZES: Mapping[str, tuple[float, float]] = {"motorcycle": (2.2, 0.9), "car": (5.0, 1.8), "truck": (7.1, 2.4)}
# What sources that write words for kinds call vehicles, and the kinds of a recording.
KINDS: Mapping[str, str] = {"car": "car", "van": "car", "truck": "truck", "bus": "truck", "motorcycle": "motorcycle"}


def whole_ids(names: pl.Series) -> tuple[pl.Series, int]:
    """Returns an id [Int32] for each name, and how many names were no whole numbers.

    If every name is a whole number, those are the ids; else names are numbered from 1 in their own order.
    """
    names = names.cast(pl.Categorical())
    unique = names.unique().drop_nulls()
    unique = unique.gather(unique.cast(pl.String).arg_sort())
    numbers = unique.cast(pl.String).cast(pl.Float64, strict=False)  # some programs write 2.0 for a whole number
    is_whole = numbers.null_count() == 0 and numbers.is_unique().all() and numbers.is_between(0, c.LARGEST).all()
    is_whole = is_whole and bool((numbers == numbers.round()).all())
    ids = numbers if is_whole else pl.Series(range(1, unique.len() + 1))
    return translated(names, unique, ids.cast(pl.Int32)), 0 if is_whole else unique.len()


def whole_names(names: pl.Series) -> pl.Series:
    """Returns names with those of whole numbers written one way: `1`, `1.0` and `1e0` are one vehicle."""
    names = names.cast(pl.Categorical())
    unique = names.unique().drop_nulls()
    words = [whole_name(name) for name in unique.cast(pl.String)]
    return translated(names, unique, pl.Series(words, dtype=pl.Categorical()))


def without_odd_numbers(rows: Rows, spelling: str, bad_rows: BadRows) -> Rows:
    """Returns the rows without those whose name is a negative or broken number, where most names are numbers.

    Args:
        rows: with a column id of names.
        spelling: of that column in the file.
        bad_rows: whether to raise an error or to skip and count them.

    Raises:
        FormatError: there is one and they are not to be skipped, or there is no other row.
    """
    unique = rows.table["id"].unique().drop_nulls()
    numbers = unique.cast(pl.String).cast(pl.Float64, strict=False)
    is_odd = (~numbers.is_finite() | (numbers < 0) | (numbers != numbers.round())).fill_null(False)
    if 2 * numbers.null_count() >= unique.len() or not is_odd.any():
        return rows
    is_bad = rows.table["id"].is_in(unique.filter(is_odd).implode())
    first = rows.table["id"].to_frame().with_row_index("row").filter(is_bad).head(MOST_LISTED)
    faults = [
        BadRow(
            rows.file,
            row + 1,
            0,
            f"{spelling}: expected a whole number, 0 or more, as others are, found '{name}'",
            "row",
        )
        for row, name in first.iter_rows()
    ]
    if bad_rows is BadRows.RAISE or is_bad.all():
        raise FormatError(advice(faults[0]))
    return without_rows(rows, is_bad, faults)


def with_sizes(rows: pl.DataFrame) -> tuple[pl.DataFrame, int]:
    """Returns the rows with typical lengths and widths where these are null or not above zero, and how many those were.

    Args:
        rows: with the columns length, width [m] and kind.
    """
    missing = {name: pl.col(name).is_null() | ~(pl.col(name) > 0) for name in (c.LENGTH, c.WIDTH)}
    count = int(rows.select(pl.any_horizontal(missing.values()).sum()).item())
    if not count:
        return rows, 0
    sizes = pl.DataFrame([TYPICAL_SIZES[kind] for kind in c.KINDS], schema=[c.LENGTH, c.WIDTH], orient="row")
    typical = {name: pl.lit(sizes[name]).gather(pl.col(c.KIND).to_physical()) for name in sizes.columns}
    filled = (
        pl.when(missing[name]).then(typical[name]).otherwise(pl.col(name)).cast(pl.Float32).alias(name)
        for name in (c.LENGTH, c.WIDTH)
    )
    return rows.with_columns(filled), count


def front_centre(px: pl.Expr, py: pl.Expr, heading: pl.Expr, length: pl.Expr) -> tuple[pl.Expr, pl.Expr]:
    """Returns the front centre [m] of vehicles of given centre [m], heading [rad, counter-clockwise] and length [m]."""
    return px + heading.cos() * length / 2, py + heading.sin() * length / 2


def without_vehicles(rows: Rows, is_bad: pl.Series, reason: str, bad_rows: BadRows) -> Rows:
    """Returns the rows without the bad ones of some vehicles; each such vehicle is listed among the faults.

    Args:
        rows: with a column id.
        is_bad: of each row.
        reason: what is wrong with them.
        bad_rows: whether to raise an error or to skip and count them.

    Raises:
        FormatError: there is one and they are not to be skipped, or there is no other row.
    """
    if not is_bad.any():
        return rows
    vehicles = rows.table["id"].filter(is_bad)
    listed = vehicles.unique().sort().head(MOST_LISTED)
    faults = [BadRow(rows.file, vehicle, 0, reason, "vehicle") for vehicle in listed]
    if bad_rows is BadRows.RAISE or is_bad.all():
        raise FormatError(f"{faults[0]}. Rows of such vehicles are skipped with --skip-bad-rows")
    return without_rows(rows, is_bad, faults)


def without_rows(rows: Rows, is_bad: pl.Series, faults: Sequence[BadRow]) -> Rows:
    """Returns the rows without the bad ones, which are counted, and some listed.

    Args:
        rows: of a file.
        is_bad: of each row.
        faults: what is wrong, of some of the bad ones.
    """
    return replace(
        rows,
        table=rows.table.filter(~is_bad),
        faults=(*rows.faults, *faults)[:MOST_LISTED],
        faults_counted=rows.faults_counted + int(is_bad.sum()),
    )
