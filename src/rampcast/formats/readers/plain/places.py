"""Places of a table that are not known, written as 0, 0: a vehicle is not there."""

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.readers.plain.mapping import Entry, TableMapping
from rampcast.formats.steps.vehicles import without_rows
from rampcast.formats.tables.columns import Rows, advice
from rampcast.recording.cutting import FASTEST, NOISE
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows
from rampcast.recording.smoothing import LONGEST_FILLED_GAP

DEGREE = 111_000.0  # [m] of a meridian


def with_places(rows: Rows, mapping: TableMapping, bad_rows: BadRows) -> Rows:
    """Returns the rows without those at 0, 0 from or to which their vehicle cannot have driven.

    Raises:
        FormatError: there is such a row and they are not to be skipped.
    """
    names = ("latitude", "longitude") if mapping.on_earth else ("x", "y")
    entries = mapping.vehicles[0]
    if len(mapping.vehicles) > 1 or not all(entries.get(name, Entry()).column for name in (*names, "vehicle")):
        return rows
    x, y = (pl.col(entries[name].column) for name in names)
    if not rows.table.select(((x == 0) & (y == 0)).any()).item():
        return rows
    is_bad = _unknown(rows.table, mapping, names)
    if not is_bad.any():
        return rows
    columns = f"{entries[names[0]].column}, {entries[names[1]].column}"
    what = f"{columns}: both are 0, and the vehicle is elsewhere before or after"
    faults = [
        BadRow(rows.file, place + 1, 0, f"{what}: a place that is not known?", "row")
        for place in is_bad.arg_true().head(MOST_LISTED).to_list()
    ]
    if bad_rows is BadRows.RAISE:
        raise FormatError(advice(faults[0]))
    return without_rows(rows, is_bad, faults)


def _unknown(table: pl.DataFrame, mapping: TableMapping, names: tuple[str, str]) -> pl.Series:
    """Returns which rows are at a place that is not known.

    They are runs of rows at 0, 0 from or to which the vehicle cannot have driven; and where there are such, all runs of
    two.
    """
    entries = mapping.vehicles[0]
    track = [entries[name].column for name in ("recording", "vehicle") if entries.get(name, Entry()).column]
    moment = next(entries[name].column for name in ("time", "frame") if entries.get(name, Entry()).column)
    unit = DEGREE if names[0] == "latitude" else abs(entries[names[0]].factor)
    x, y = (pl.col(entries[name].column).cast(pl.Float64) for name in names)
    step = mapping.time_step or 1.0 if "time" not in entries else abs(entries["time"].factor)
    elapsed, driven = pl.col(moment).diff() * step, (x.diff() ** 2 + y.diff() ** 2).sqrt() * unit
    is_zero = (x == 0) & (y == 0)
    same = pl.all_horizontal(pl.col(name) == pl.col(name).shift() for name in track).fill_null(False)
    sorted_rows = table.with_row_index("row").sort(*track, moment, maintain_order=True)
    runs = sorted_rows.select(
        "row",
        zero=is_zero,
        far=same & (elapsed <= LONGEST_FILLED_GAP) & (driven > NOISE + FASTEST * elapsed),
        run=(~same | is_zero.ne(is_zero.shift())).fill_null(True).cum_sum(),
    ).with_columns(far=pl.col("far") | pl.col("far").shift(-1).fill_null(False))
    found = runs.with_columns(size=pl.len().over("run"), is_far=pl.col("far").any().over("run"))
    is_bad = pl.col("zero") & (pl.col("is_far") | (pl.col("size") > 1))
    known = found.select((pl.col("zero") & pl.col("is_far")).any()).item()
    return found.select("row", bad=is_bad & pl.lit(known)).sort("row")["bad"]
