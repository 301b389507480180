"""Rows of NGSIM files: a fast path for chunks without a fault, and a careful one that finds line and column of each."""

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from rampcast.formats.readers.ngsim.layout import LOCATION, NUMBERS, WHOLE_NUMBERS, Layout
from rampcast.formats.readers.ngsim.text import Body, body_of
from rampcast.formats.steps.units import FOOT
from rampcast.recording.reading import BadRow
from rampcast.sites import Site

PLAIN, GROUPED = "plain", "grouped"  # how a file writes numbers of 1,000 and more: 1234.5 or "1,234.5"
GROUPED_NUMBER = r"^[+-]?\d{1,3}(,\d{3})+(\.\d+)?$"
NARROW = dict.fromkeys(NUMBERS, pl.Float64()) | {  # as wide as a recording needs, which saves a conversion
    "vehicle_id": pl.Int32(),
    "frame_id": pl.Int32(),
    "global_time": pl.Int64(),
    "v_length": pl.Float32(),
    "v_width": pl.Float32(),
    "v_class": pl.Int8(),
    "v_vel": pl.Float32(),
    "v_acc": pl.Float32(),
    "lane_id": pl.Int16(),
}
NUL = "\ufffd"  # stands for a NUL byte where the csv module refuses one
INT32 = 2.0**31 - 1
LATEST = 4_102_444_800_000.0  # [ms since 1970] the year 2100
LONGEST, WIDEST = 200.0, 30.0  # [ft] no road vehicle is larger
FASTEST = 500.0  # [ft/s] no car drives 550 km/h; NGSIM writes up to 95.3 ft/s
STRONGEST = 3000.0  # [ft/s^2] 93 g; NGSIM clips at 11.2 ft/s^2
BESIDE = 50.0  # [m] positions this far beside the outer lanes are still believed
BEYOND = 0.25  # share of the site's length by which a position may lie outside; the originals go 9 % beyond


@dataclass(frozen=True)
class Rules:
    """What a row of one site may hold, in the file's units: a range for every number, the lanes, the location."""

    ranges: Mapping[str, tuple[float, float]]
    lanes: tuple[int, ...]
    site: str
    location: str


@dataclass(frozen=True)
class Parsed:
    """The good rows of a chunk in the file's units, and what was beside them.

    Attributes:
        rows: the wanted columns of this site's rows.
        other_locations: number of rows of each other location.
        styles: how each column writes numbers of 1,000 and more, where it has some.
        lines: lines of the chunk, blank ones among them.
        grouped_numbers: numbers written with thousands separators.
        faults: the bad rows.
    """

    rows: pl.DataFrame
    other_locations: Mapping[str, int]
    styles: Mapping[str, str]
    lines: int
    grouped_numbers: int = 0
    faults: tuple[BadRow, ...] = ()


def rules_of(site: Site) -> Rules:
    """Returns what a row of that site may hold."""
    feet = 1 / FOOT
    lateral = [-lane.centre for lane in site.lanes]
    ranges = {
        "vehicle_id": (0.0, INT32),
        "frame_id": (0.0, INT32),
        "global_time": (0.0, LATEST),
        "local_x": ((min(lateral) - BESIDE) * feet, (max(lateral) + BESIDE) * feet),
        "local_y": (-BEYOND * site.length * feet, (1 + BEYOND) * site.length * feet),
        "v_length": (0.0, LONGEST),
        "v_width": (0.0, WIDEST),
        "v_class": (1.0, 3.0),
        "v_vel": (-FASTEST, FASTEST),
        "v_acc": (-STRONGEST, STRONGEST),
    }
    return Rules(ranges, tuple(lane.number for lane in site.lanes), site.name, site.location.lower())


def parse_chunk(chunk: bytes, layout: Layout, rules: Rules) -> Parsed | None:
    """Returns the rows of a chunk of whole lines, or None if anything in it is not as expected."""
    if b"\0" in chunk:
        return None
    body = body_of(chunk, layout)
    if not body.rows:
        return Parsed(empty_rows(layout), {}, {}, body.lines)
    if not body.is_whole:  # polars would take long for it
        return None
    table, grouped = (_read_grouped if b'"' in body.text else _read_plain)(body)
    if table is None or table.height != body.rows:
        return None
    rows, others = _this_location(table, body.layout, rules)
    extent = _extent(rows)
    if not _obeys(rows, extent, rules):
        return None
    large = [name for name, (low, high) in extent.items() if name not in grouped and max(-low, high) >= 1000]
    styles = dict.fromkeys(grouped, GROUPED) | dict.fromkeys(large, PLAIN)
    return Parsed(rows, others, styles, body.lines, sum(grouped.values()))


def parse_lines(
    chunk: bytes, layout: Layout, rules: Rules, *, file: str, first_line: int, styles: Mapping[str, str]
) -> Parsed:
    """Returns the good rows of a chunk and every bad one with line, column and reason; slow.

    Args:
        chunk: whole lines.
        layout: of the file.
        rules: of the site.
        file: its name for messages.
        first_line: the number of the chunk's first line, from 1.
        styles: how each column writes numbers of 1,000 and more, as far as earlier chunks showed.
    """
    lines = list(_split(chunk, layout, first_line))
    if layout.separator != " ":  # text has no thousands separators
        styles = {**_majority_styles(lines, layout), **styles}
    good: dict[str, list[float]] = {name: [] for name in layout.numbers}
    others: dict[str, int] = {}
    faults = []
    for number, cells in lines:
        location = _other_location(cells, layout, rules)
        if location:
            others[location] = others.get(location, 0) + 1
            continue
        values, fault = _read_cells(cells, layout, rules, styles)
        if fault:
            faults.append(BadRow(file, number, *fault))
            continue
        for name, value in values.items():
            good[name].append(value)
    rows = pl.DataFrame(good, schema=dict.fromkeys(layout.numbers, pl.Float64))
    grouped = sum("," in cells[i] for _, cells in lines for i in _indices(layout) if i < len(cells))
    return Parsed(rows, others, styles, chunk.count(b"\n"), grouped, tuple(faults))


def empty_rows(layout: Layout) -> pl.DataFrame:
    """Returns a table of no rows with the wanted columns."""
    return pl.DataFrame(schema=dict.fromkeys(layout.numbers, pl.Float64))


def _read_plain(body: Body) -> tuple[pl.DataFrame | None, dict[str, int]]:
    table = _read_csv(body, NARROW)
    if table is None:  # csv written by other programs may say 2.0 for a whole number
        table = _read_csv(body, dict.fromkeys(NUMBERS, pl.Float64()))
    return table, {}


def _read_grouped(body: Body) -> tuple[pl.DataFrame | None, dict[str, int]]:
    """Returns the table and how many numbers of each column are written as "1,234.5"; a mixed column is a fault."""
    names = body.layout.numbers
    texts = _read_csv(body, dict.fromkeys(names, pl.String()))
    if texts is None:
        return None, {}
    counts = texts.select(pl.col(name).str.contains(GROUPED_NUMBER).sum() for name in names).row(0, named=True)
    grouped = {name: count for name, count in counts.items() if count}
    plain = (pl.when(pl.col(name).str.contains(GROUPED_NUMBER).not_()).then(pl.col(name)) for name in grouped)
    try:
        mixed = texts.select((p.cast(pl.Float64).abs() >= 1000).any() for p in plain)
        table = texts.with_columns(
            (pl.col(name).str.replace_all(",", "", literal=True) if name in grouped else pl.col(name)).cast(pl.Float64)
            for name in names
        )
    except pl.exceptions.PolarsError:
        return None, {}
    return (None if mixed.width and any(mixed.row(0)) else table), grouped


def _read_csv(body: Body, types: Mapping[str, Any]) -> pl.DataFrame | None:
    """Returns the wanted columns, or None if a cell is missing or is no number, or a row has too many columns.

    Args:
        body: the rows.
        types: polars type of each wanted column.
    """
    layout = body.layout
    names = [f"{index}:{name}" for index, name in enumerate(layout.names)]  # a header may name a column twice
    quoted = b'"' in body.text  # then only an empty last column tells that a row is cut off
    last = len(names) - 1
    read = [i for i, name in enumerate(layout.names) if name in layout.wanted or (quoted and i == last)]
    try:
        table = pl.read_csv(
            io.BytesIO(body.text),
            has_header=False,
            separator=layout.separator,
            quote_char=None if layout.separator == " " else '"',
            columns=read,
            schema={full: types.get(name, pl.String()) for full, name in zip(names, layout.names, strict=True)},
        )
    except pl.exceptions.PolarsError:
        return None
    if table.height == 0 or sum(table.null_count().row(0)) > 0:
        return None
    return table.select(pl.col(names[i]).alias(layout.names[i]) for i in read if layout.names[i] in layout.wanted)


def _this_location(table: pl.DataFrame, layout: Layout, rules: Rules) -> tuple[pl.DataFrame, dict[str, int]]:
    if not layout.has_location:
        return table, {}
    name = pl.col(LOCATION).str.strip_chars(' "').str.to_lowercase()
    here = table.select(name == rules.location).to_series()
    counts = table.filter(~here).select(name).to_series().value_counts()
    return table.filter(here).drop(LOCATION), dict(counts.iter_rows())


def _extent(rows: pl.DataFrame) -> dict[str, tuple[float, float]]:
    """Returns the smallest and largest number of each column; a column with NaN has no numbers at all."""
    names = [name for name in NUMBERS if name in rows.columns]
    sizes = (agg.alias(f"{index} {name}") for name in names for index, agg in enumerate(_least_and_most(name)))
    found = rows.select(sizes).row(0, named=True) if rows.height else {}
    return {name: (float(found[f"0 {name}"]), float(found[f"1 {name}"])) for name in names if found}


def _least_and_most(name: str) -> tuple[pl.Expr, pl.Expr]:
    return pl.col(name).nan_min(), pl.col(name).nan_max()


def _obeys(rows: pl.DataFrame, extent: Mapping[str, tuple[float, float]], rules: Rules) -> bool:
    """Returns whether all rows are as they should be; a comparison with NaN is False."""
    within = all(low <= extent[n][0] and extent[n][1] <= high for n, (low, high) in rules.ranges.items() if n in extent)
    whole = [(pl.col(n) == pl.col(n).floor()).all() for n in WHOLE_NUMBERS if rows.schema[n] == pl.Float64]
    lanes = pl.col("lane_id").cast(pl.Float64).is_in([float(lane) for lane in rules.lanes]).all()
    return within and all(rows.select(**{str(i): check for i, check in enumerate([*whole, lanes])}).row(0))


def _indices(layout: Layout) -> list[int]:
    return [index for index, name in enumerate(layout.names) if name in NUMBERS]


def _split(chunk: bytes, layout: Layout, first_line: int) -> Iterator[tuple[int, list[str]]]:
    """Yields the number and the cells of every line that is not blank."""
    for number, line in enumerate(chunk.decode("latin-1").split("\n"), start=first_line):
        if not line.strip(" \t\r"):
            continue
        if layout.separator == " ":
            yield number, line.split()
        else:
            yield number, _csv_cells(line)


def _csv_cells(line: str) -> list[str]:
    """Returns the cells of one line: a quote that is never closed would swallow the lines that follow."""
    try:
        return next(csv.reader([line.strip("\r").replace("\r", " ").replace("\0", NUL)]), [])
    except csv.Error:  # a cell of more than 128 KB
        return [line]


def _majority_styles(lines: list[tuple[int, list[str]]], layout: Layout) -> dict[str, str]:
    styles = {}
    for index in _indices(layout):
        cells = [row[index] for _, row in lines if index < len(row)]
        grouped = sum("," in cell for cell in cells)
        plain = sum("," not in cell and len(cell.split(".")[0].lstrip("+-")) > 3 for cell in cells)
        if grouped or plain:
            styles[layout.names[index]] = GROUPED if grouped > plain else PLAIN
    return styles


def _other_location(cells: list[str], layout: Layout, rules: Rules) -> str:
    if not layout.has_location or len(cells) != len(layout.names):
        return ""
    location = cells[layout.names.index(LOCATION)].strip(' "').lower()
    return location if location != rules.location and location.isprintable() else ""


def _read_cells(
    cells: list[str], layout: Layout, rules: Rules, styles: Mapping[str, str]
) -> tuple[dict[str, float], tuple[int, str] | None]:
    """Returns the wanted numbers of a row, and its first fault as (column from 1, reason)."""
    values: dict[str, float] = {}
    nul = next((i for i, cell in enumerate(cells) if "\0" in cell or NUL in cell), None)
    if nul is not None:
        return values, (nul + 1, "a NUL byte: this part of the file was not written; get the file again")
    if len(cells) != len(layout.names):
        return values, (0, _wrong_count(len(cells), len(layout.names)))
    for index in _indices(layout):
        name = layout.names[index]
        value, reason = _read_number(cells[index].strip(), name, rules, styles.get(name, ""))
        if reason:
            return values, (index + 1, f"{name}: {reason}")
        values[name] = value
    return values, None


def _wrong_count(found: int, expected: int) -> str:
    if found < expected:
        return f"expected {expected} columns, found {found}: the row is cut off; get the file again"
    return f"expected {expected} columns, found {found}; a number with an unquoted thousands separator adds one"


def _read_number(cell: str, name: str, rules: Rules, style: str) -> tuple[float, str]:
    """Returns the number in a cell, or NaN and what is wrong with it."""
    shown = f"'{cell[:40]}'"
    grouped = "," in cell
    if grouped and (style != GROUPED or not pl.Series([cell]).str.contains(GROUPED_NUMBER).item()):
        return np.nan, f"expected a number, found {shown} with a thousands separator; write it without the comma"
    try:
        value = float(cell.replace(",", ""))
    except ValueError:
        return np.nan, "expected a number, the cell is empty" if not cell else f"expected a number, found {shown}"
    if not np.isfinite(value):
        return np.nan, f"expected a finite number, found {shown}"
    if abs(value) >= 1000 and style == GROUPED and not grouped:
        return np.nan, f"found {shown} without a thousands separator where the rows around it have one"
    if name in WHOLE_NUMBERS and value != int(value):
        return np.nan, f"expected a whole number, found {shown}"
    if name == "lane_id":
        known = value in rules.lanes
        lanes = ", ".join(map(str, rules.lanes))
        return value, "" if known else f"lane {shown} is unknown: site {rules.site} has the lanes {lanes}"
    low, high = rules.ranges[name]
    if not low <= value <= high:
        return np.nan, f"expected {low:,.0f} to {high:,.0f}, found {shown}"
    return value, ""
