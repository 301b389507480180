"""pNEUMA: 25 Hz drone recordings of Athens; one csv a drone and half hour, with one row a vehicle as long as its track.

A row holds what is of the whole vehicle, then six cells for each moment. Positions are degrees (WGS84), taken as the
vehicles' centres; there are no headings, lanes or sizes. See docs/formats/pneuma.md.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head, plain
from rampcast.formats.files.sources import open_source, parse_ahead, read_chunks
from rampcast.formats.format import Format, Recordings, table_of
from rampcast.formats.steps import believed
from rampcast.formats.steps.clock import check_one_step, whole_frames
from rampcast.formats.steps.earth import in_metres
from rampcast.formats.steps.motion import with_fronts
from rampcast.formats.steps.places import different_names, one_place
from rampcast.formats.steps.units import KILOMETRE_PER_HOUR
from rampcast.formats.steps.vehicles import with_sizes
from rampcast.formats.tables.columns import SHOWN, Column, advice, read_cell
from rampcast.recording import columns as c
from rampcast.recording.reading import MOST_LISTED, BadRow, BadRows, ReadReport, join_reports
from rampcast.roads.plane import PLANE_SCHEMA, PX, PY, Plane, plane_rows
from rampcast.roads.project import on_roads
from rampcast.sites import Site

LATEST = 1e6  # [s] of a recording of half an hour
LONGEST_ROW = 8 << 20  # [bytes] a vehicle that is seen for half an hour has some 3 MB
NAME = re.compile(r"\d{8}_(d\w+?)_\d{4}_\d{4}")  # 20181024_d1_0830_0900: day, drone, from, to
KINDS = {
    "Car": "car",
    "Taxi": "car",
    "Bus": "truck",
    "Medium Vehicle": "truck",
    "Heavy Vehicle": "truck",
    "Motorcycle": "motorcycle",
}
VEHICLE = (
    believed.number("id", "track_id"),
    Column("type", ("type",), pl.String()),
    Column("way", ("traveled_d",)),
    Column("mean speed", ("avg_speed",)),
)
MOMENT = (
    Column("latitude", ("lat",), low=-84, high=84),
    Column("longitude", ("lon",), low=-180, high=180),
    Column("speed", ("speed",), low=-540, high=540),  # [km/h], as fast as `believed`
    Column("acceleration", ("lon_acc",), low=-1000, high=1000),
    Column("lateral acceleration", ("lat_acc",), low=-1000, high=1000),
    Column("time", ("time",), low=0, high=LATEST),
)
NAMES = tuple(column.spellings[0] for column in (*VEHICLE, *MOMENT))
FIRST, GROUP = len(VEHICLE), len(MOMENT)  # cells of a row before its first moment, and of each moment


@dataclass(frozen=True)
class _Lines:
    """What some lines of a file hold: a row a moment; (line from 0, column from 1, reason) and moments of bad ones."""

    rows: pl.DataFrame
    faults: list[tuple[int, int, str]]
    moments_lost: int


def read_pneuma(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the recordings in pNEUMA's files of one place, one a road, each file a part; and what reading found."""
    paths = [head.path for head in heads]
    found = [NAME.search(path.name) for path in paths]
    place = one_place(paths, [match[1] if match else "" for match in found])
    parts = different_names(paths, [path.name.partition(".")[0] for path in paths])
    files = [_read_file(head, part, bad_rows) for head, part in zip(heads, parts, strict=True)]
    steps = [time_step for _, time_step, _ in files]
    check_one_step(paths, steps)
    rows = pl.concat([rows for rows, _, _ in files])
    px, py = in_metres(rows["latitude"].to_numpy(), rows["longitude"].to_numpy())
    rows, filled = with_sizes(plane_rows(rows, {PX: pl.Series(px), PY: pl.Series(py)}))
    plane = Plane(
        name="-".join(filter(None, ("pneuma", place))),
        title=f"pNEUMA, {place}" if place else "pNEUMA",
        source="pneuma",
        rows=with_fronts(rows, time_step=steps[0]),
        time_step=steps[0],
    )
    more = ReadReport((), (), 0, sizes_filled=filled)
    return on_roads(plane, site, join_reports([*(report for _, _, report in files), more]))


def _read_file(head: Head, part: str, bad_rows: BadRows) -> tuple[pl.DataFrame, float, ReadReport]:
    """Returns the moments of a file as columns of a plane but for the places, its time step [s], and the report."""
    if head.header is None or tuple(map(plain, head.header.names[: len(NAMES)])) != NAMES:
        raise FormatError(
            f"{head.name}: expected a first line that names {'; '.join(NAMES)}, in this order; see docs/formats/"
            "pneuma.md"
        )
    pieces: list[pl.DataFrame] = []
    faults: list[BadRow] = []
    lost, line = 0, head.header.lines + 1
    with open_source(head.path) as (name, stream):
        for _ in range(head.header.lines):
            stream.readline(LONGEST_ROW)
        parse = partial(_parse, separator=head.header.separator)
        for chunk, found in parse_ahead(read_chunks(name, stream, longest_line=LONGEST_ROW), parse):
            faults += [BadRow(name, line + place, column, reason) for place, column, reason in found.faults]
            if faults and bad_rows is BadRows.RAISE:
                raise FormatError(advice(faults[0]))
            lost, line = lost + found.moments_lost, line + chunk.count(b"\n")
            pieces.append(found.rows)
    rows = pl.concat(pieces) if pieces else pl.DataFrame()
    if rows.is_empty():
        why = f"none of its rows can be read. {faults[0]}" if faults else "the file has a header but no rows"
        raise FormatError(f"{head.name}: {why}; get the file again")
    frames, time_step, slips = whole_frames(head.name, rows["time"])
    report = ReadReport(
        files=(head.name,),
        forms=("pNEUMA trajectories",),
        rows_read=rows.height + lost,
        rows_skipped=lost,
        skipped=tuple(faults[:MOST_LISTED]),
        clock_slips=slips,
    )
    part_name = pl.lit(part, PLANE_SCHEMA[c.RECORDING]).alias(c.RECORDING)
    return rows.with_columns(part_name, pl.Series(c.FRAME, frames)), time_step, report


def _parse(chunk: bytes, separator: str) -> _Lines:
    """Returns what whole lines hold, whose cells are parted by `;`, or by commas as other programs write them."""
    lines = chunk.decode("utf-8", "replace").split("\n")
    places = [place for place, line in enumerate(lines) if line.strip()]
    text = pl.Series([lines[place] for place in places], dtype=pl.String).str.strip_chars_end(" \t\r")
    cells = text.str.strip_suffix(separator).str.split(separator)
    counts = cells.list.len().to_numpy().astype(np.int64) - FIRST
    reasons = [_fault(first, int(n)) for first, n in zip(cells.list.head(FIRST), counts, strict=True)]
    good = np.array([not reason for _, reason in reasons], bool)
    values, wrong = _moments(cells.filter(pl.Series(good)), counts[good] // GROUP)
    for index, fault in zip(np.flatnonzero(good), wrong, strict=True):
        reasons[index] = fault
    moments = np.maximum(counts // GROUP, 1)
    is_read = np.array([not reason for _, reason in reasons], bool)
    kept = is_read[good].repeat(moments[good])
    rows = _rows(cells.filter(pl.Series(is_read)), values[kept], moments[is_read])
    faults = [(place, *reason) for place, reason in zip(places, reasons, strict=True) if reason[1]]
    return _Lines(rows, faults, int(moments[~is_read].sum()))


def _fault(first: pl.Series, count: int) -> tuple[int, str]:
    """Returns the column and what is wrong with the cells of a whole vehicle or the count of the others; "" if nothing.

    Args:
        first: cells before those of moments.
        count: of the cells of moments.
    """
    if count < GROUP:
        return 0, f"expected {FIRST} columns and {GROUP} for each moment, found {FIRST + count}: the row is cut off"
    if count % GROUP:
        what = f"expected {GROUP} columns for each moment behind the first {FIRST}, found {count}, {count % GROUP} over"
        return 0, f"{what}: the row is cut off"
    _, reason = read_cell(first[0].strip(), VEHICLE[0])
    if reason:
        return 1, f"{NAMES[0]}: {reason}"
    kind = first[1].strip(' "')
    return (0, "") if kind in KINDS else (2, f"type: expected one of {', '.join(KINDS)}, found '{kind[:SHOWN]}'")


def _moments(cells: pl.Series, counts: np.ndarray) -> tuple[Float[np.ndarray, "moment 6"], list[tuple[int, str]]]:
    """Returns the numbers of each moment of vehicles, and the first fault of each vehicle, as `_fault` does."""
    text = cells.list.slice(FIRST).explode(empty_as_null=False).str.strip_chars()
    numbers = text.cast(pl.Float64, strict=False).to_numpy().reshape(-1, GROUP)
    low, high = (np.array([getattr(column, end) for column in MOMENT]) for end in ("low", "high"))
    is_bad = ~((numbers >= low) & (numbers <= high))
    wrong = [(0, "")] * len(counts)
    starts = np.cumsum(counts) - counts
    for row, column in np.argwhere(is_bad)[::-1]:  # the first one of a vehicle last, which stays
        vehicle = int(np.searchsorted(starts, row, side="right")) - 1
        place = FIRST + (row - starts[vehicle]) * GROUP + column
        _, reason = read_cell(text[int(row * GROUP + column)], MOMENT[column])
        wrong[vehicle] = int(place) + 1, f"{NAMES[FIRST + column]}: {reason}"
    return numbers, wrong


def _rows(cells: pl.Series, values: Float[np.ndarray, "moment 6"], moments: np.ndarray) -> pl.DataFrame:
    """Returns the moments of vehicles with places in degrees, and times."""
    first = [(int(float(cell[0])), KINDS[cell[1].strip(' "')]) for cell in cells.list.head(2)]
    ids = np.array([number for number, _ in first], np.int32).repeat(moments)
    kinds = pl.Series([kind for _, kind in first], dtype=PLANE_SCHEMA[c.KIND])
    moment = {column.name: values[:, index] for index, column in enumerate(MOMENT)}
    return pl.DataFrame(moment).select(
        "latitude",
        "longitude",
        "time",
        pl.Series(c.VEHICLE, ids),
        kinds.gather(np.arange(len(first)).repeat(moments)).alias(c.KIND),
        (pl.col("speed") * KILOMETRE_PER_HOUR).alias(c.RECORDED_V),
        pl.col("acceleration").alias(c.RECORDED_A),
    )


PNEUMA = Format("pneuma", "pNEUMA, streets of Athens", ".csv, in .gz or .zip", read_pneuma, table_of(VEHICLE + MOMENT))
