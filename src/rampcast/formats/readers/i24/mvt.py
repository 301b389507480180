"""I-24 MOTION with lanes: the MegaVanderTest's version 2.1, its json files or tables with one row a moment.

Vehicles are cut at lane changes: each piece is a vehicle of its own. Positions are in metres from Mill Creek bridge,
sizes in feet. Source: the code that made the data, of the CIRCLES consortium; see docs/formats/i24_mvt.md.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head
from rampcast.formats.format import Door, Format, Recordings, table_of
from rampcast.formats.readers.i24.carriageways import convert_tracks, i24_sites, read_tracks
from rampcast.formats.readers.i24.stream import Batch, read_batches
from rampcast.formats.readers.i24.table import clock_of_rows, sampled_rows, starts_of
from rampcast.formats.readers.i24.tracks import EAST, KINDS, LANES, LATEST, LONGEST, WEST, WIDEST, Fault, Keys
from rampcast.formats.steps.units import FOOT
from rampcast.formats.steps.vehicles import whole_ids
from rampcast.formats.tables.columns import Column, missing_column
from rampcast.formats.tables.rows import read_rows
from rampcast.recording.reading import BadRows, ReadReport, join_reports
from rampcast.sites import Site

ORIGIN = 309_804.0625 * FOOT  # [m] where v1's x has the Mill Creek bridge
FAR = 100_000.0  # [m]
KEYS = Keys(
    title="I-24 MOTION MVT v2.1",
    source="i24_mvt",
    id="trajectory_id",
    arrays={
        "x": "x_position_meters",
        "y": "y_position_corrected_meters",
        "v": "speed_meters_per_second",
        "a": "acceleration_meters_per_second_per_second",
    },
    unit=1.0,
    lane="lane_number",
    has_direction=False,
)
COLUMNS = (
    Column("id", (KEYS.id,), pl.Categorical()),
    Column("time", ("timestamp",), low=0, high=LATEST),
    Column("x", (KEYS.arrays["x"],), low=-FAR, high=FAR),
    Column("y", (KEYS.arrays["y"],), low=-FAR, high=FAR),
    Column("lane", (KEYS.lane,), pl.Int16(), LANES[0], LANES[-1]),
    Column("v", (KEYS.arrays["v"],), low=-150, high=150, may_be_blank=True),
    Column("a", (KEYS.arrays["a"],), low=-1000, high=1000, optional=True, may_be_blank=True),
    Column("length", ("length",), low=0, high=LONGEST, optional=True, may_be_blank=True),
    Column("width", ("width",), low=0, high=WIDEST, optional=True, may_be_blank=True),
    Column("class", ("coarse_vehicle_class",), pl.Int8(), min(KINDS), max(KINDS), optional=True, may_be_blank=True),
    Column("direction", ("direction",), pl.Int8(), WEST, EAST, optional=True),
)
TYPICAL_CLASS = 0  # where none is given: a sedan


def misses_i24_mvt(head: Head) -> str | None:
    """Returns the first thing a file lacks to be this; None if nothing."""
    if _is_json(head.text):
        return None if f'"{KEYS.id}"'.encode() in head.text else f"no key '{KEYS.id}' in its first vehicle"
    return missing_column(head, COLUMNS)


def read_i24_mvt(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the carriageways in the files, each a recording, and what reading found.

    The files are all json or all tables; without a site whole carriageways are taken.
    """
    return read_tracks(_batches(heads, bad_rows), KEYS.source, i24_sites(origin=ORIGIN), site)


def convert_i24_mvt(
    heads: Sequence[Head], out: Path, site: Site | None, bad_rows: BadRows, door: Door
) -> tuple[tuple[Path, ...], ReadReport]:
    """Writes what `read_i24_mvt` returns as recordings' files; with little memory where the files are json.

    Args:
        out: the file to write; where both carriageways are in the files there are two, OUT-west and OUT-east.
        door: is given what is wrong with the recordings, and may refuse it.
    """
    return convert_tracks(_batches(heads, bad_rows), Path(out), KEYS.source, i24_sites(origin=ORIGIN), site, door)


def _is_json(text: bytes) -> bool:
    return text.lstrip().startswith(b"[")


def _batches(heads: Sequence[Head], bad_rows: BadRows) -> Iterator[Batch]:
    are_json = [_is_json(head.text) for head in heads]
    if all(are_json):
        yield from read_batches([head.path for head in heads], KEYS, bad_rows)
    elif any(are_json):
        raise FormatError(f"{heads[are_json.index(True)].path}: a json file among tables; convert each kind by itself")
    else:
        yield _batch(heads, bad_rows)


def _batch(heads: Sequence[Head], bad_rows: BadRows) -> Batch:
    """Returns all vehicles of tables."""
    files = [read_rows(head, COLUMNS, bad_rows=bad_rows) for head in heads]
    report = join_reports([one.report(KEYS.title) for one in files])
    table = pl.concat([_completed(one.table) for one in files])
    numbers, _ = whole_ids(table["id"])
    table = table.with_columns(numbers.alias("number"))
    unique, key = table, ["number", "time"]
    if not _is_sorted(table):
        unique = table.sort(key).unique(key, keep="first", maintain_order=True)
    clock = clock_of_rows(unique)
    try:
        rows, found = sampled_rows(unique, clock)
    except Fault as error:
        raise FormatError(f"{', '.join(report.files)}: {error}") from error
    names = tuple(unique["id"].gather(starts_of(unique)).cast(pl.String))
    removed = ReadReport((), (), 0, duplicates=table.height - unique.height)
    return Batch(rows, names, clock.step, join_reports([report, removed, found]))


def _completed(table: pl.DataFrame) -> pl.DataFrame:
    """Returns the rows with all columns; driving west, and sedans, where the file does not say."""
    absent = {column.name: pl.lit(None, column.type) for column in COLUMNS if column.name not in table.columns}
    return table.with_columns(**absent).select(
        *(column.name for column in COLUMNS if column.name not in ("class", "direction")),
        pl.col("class").fill_null(TYPICAL_CLASS),
        pl.col("direction").fill_null(WEST),
    )


def _is_sorted(table: pl.DataFrame) -> bool:
    """Returns whether vehicles, and in them times, only grow."""
    vehicle, time = np.diff(table["number"].to_numpy()), np.diff(table["time"].to_numpy())
    return bool(((vehicle > 0) | ((vehicle == 0) & (time > 0))).all())


I24_MVT = Format(
    "i24_mvt",
    "I-24 MOTION with lanes (MVT v2.1)",
    ".json, .csv, .parquet",
    read_i24_mvt,
    table_of(COLUMNS, misses_i24_mvt),
    convert_i24_mvt,
)
