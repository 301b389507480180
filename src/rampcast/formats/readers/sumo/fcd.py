"""SUMO's floating car data (--fcd-output), as xml, csv or parquet: where every simulated vehicle is at every time step.

Positions are the middle of the front bumper in the plane of the net, which grows to the east and to the north.
Source: SUMO's documentation of FCDOutput, and what SUMO 1.28 writes; see docs/formats/sumo.md.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import polars as pl
from jaxtyping import Int

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head, plain
from rampcast.formats.files.xml_text import find_root
from rampcast.formats.format import Format, Recordings, table_of
from rampcast.formats.readers.sumo.xml_careful import ROOT
from rampcast.formats.readers.sumo.xml_fast import read_fcd_xml
from rampcast.formats.steps import believed
from rampcast.formats.steps.clock import check_one_step, seconds, whole_frames
from rampcast.formats.steps.vehicles import whole_ids, with_sizes
from rampcast.formats.tables.columns import SHOWN, Column, Rows, missing_column
from rampcast.formats.tables.rows import read_rows
from rampcast.recording import columns as c
from rampcast.recording.reading import BadRows, ReadReport, join_reports
from rampcast.recording.translation import translated
from rampcast.roads.plane import PLANE_SCHEMA, PX, PY, SOURCE_LANE, Plane, plane_rows
from rampcast.roads.project import on_roads
from rampcast.sites import Site

LATEST = 1e8  # [s] three years
TAGS = ("vehicle", "person", "container")  # csv and parquet name all columns for the element that came first
TIMES = ("timestep_time", "time")
PLAIN = {"time", "id", "x", "y", "angle", "pos", "slope"}  # tells SUMO's csv with --output.column-header plain

# Words in the id of a vehicle's type, mostly SUMO's vehicle classes; the first of them counts. All others are cars.
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")  # heavy_truck, heavyTruck
ENDINGS = re.compile(r"type$|s$")  # SUMO's own types are called DEFAULT_BIKETYPE
COMPOUND = "truck"  # stands in words of many a type, as heavytruck and trucktrailer; busy cars are no buses
KINDS = {
    "motorcycle": "motorcycle",
    "motorbike": "motorcycle",
    "moped": "motorcycle",
    "truck": "truck",
    "lorry": "truck",
    "trailer": "truck",
    "semitrailer": "truck",
    "hgv": "truck",
    "bus": "truck",
    "buse": "truck",  # without its s
    "coach": "truck",
    "bicycle": None,
    "bike": None,
    "pedestrian": None,
    "ped": None,
    "container": None,
    "wheelchair": None,
    "rail": None,
    "tram": None,
}
CHECKED = 100_000  # rows from the beginning that tell whether positions are in degrees
NARROW = 1e-3  # of the way that the speed tells: positions in degrees move by 1e-5 of it


def _named(name: str) -> tuple[str, ...]:
    """Returns how the forms name an attribute: xml, then csv and parquet with each of SUMO's kinds of headers."""
    return (name, *(f"{prefix}{tag}_{name}" for prefix in ("", "timestep_") for tag in TAGS))


# SUMO writes -1073741824 where a vehicle has no position, which is beyond all maps.
ATTRIBUTES = (
    Column("id", _named("id"), pl.Categorical(), is_key=True),
    believed.place("x", *_named("x"), farthest=believed.FARTHEST_UTM),
    believed.place("y", *_named("y"), farthest=believed.FARTHEST_UTM),
    Column("type", _named("type"), pl.Categorical(), optional=True, may_be_blank=True),
    Column("lane", _named("lane"), pl.Categorical(), optional=True, may_be_blank=True),
    believed.speed("speed", *_named("speed"), optional=True),
    believed.acceleration("acceleration", *_named("acceleration"), optional=True),
)
EDGE = Column("edge", _named("edge"), pl.Categorical(), optional=True, may_be_blank=True)  # filled for persons only

BESIDE = tuple(  # in the csv that xml2csv.py makes, persons and containers have columns of their own
    Column(
        f"{tag}_id",
        (f"{tag}_id", f"timestep_{tag}_id"),
        pl.Categorical(),
        optional=True,
        may_be_blank=True,
        of_others=tag,
    )
    for tag in TAGS[1:]
)


def misses_sumo(head: Head) -> str | None:
    """Returns the first thing a file lacks to be SUMO's floating car data; None if nothing."""
    if not head.names:
        root = find_root(head.text)
        return None if root is not None and root.name == ROOT else f"neither <{ROOT}> nor a header that names columns"
    names = {plain(name) for name in head.names}
    if TIMES[0] not in names and not names >= PLAIN:
        return f"no column '{TIMES[0]}'"
    return missing_column(head, ATTRIBUTES)


def read_sumo(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the recordings in floating car data of one net, and what reading found; the files are parts 1, 2, ..."""
    parts = [_read(head, f"{number}", bad_rows) for number, head in enumerate(heads, start=1)]
    steps = [time_step for _, time_step, _ in parts]
    check_one_step([head.path for head in heads], steps)
    rows = pl.concat([part for part, _, _ in parts])
    plane = Plane(name="sumo", title="SUMO", source="sumo", rows=rows, time_step=steps[0], simulated=True)
    return on_roads(plane, site, join_reports([report for _, _, report in parts]))


def _read(head: Head, part: str, bad_rows: BadRows) -> tuple[pl.DataFrame, float, ReadReport]:
    """Returns the rows of a file in its plane, its time step [s], and what reading found."""
    rows, others = _rows(head, bad_rows)
    table, others = _vehicles_only(rows.table, others)
    if table.is_empty():
        raise FormatError(
            f"{rows.file}: there are only persons, bicycles and containers in it, {others:,} rows; "
            "expected vehicles. Was it written with --fcd-output.filter-edges or a wrong --device.fcd.probability?"
        )
    frames, time_step, slips = whole_frames(rows.file, table["time"])
    _check_metres(rows.file, table, frames, time_step)
    ids, renumbered = whole_ids(table["id"])
    sized, filled = with_sizes(_in_plane(table, part, ids, frames))
    report = ReadReport(
        files=(rows.file,),
        forms=("SUMO floating car data",),
        rows_read=table.height + others + rows.faults_counted,
        rows_skipped=rows.faults_counted,
        skipped=rows.faults,
        clock_slips=slips,
        rows_not_vehicles=others,
        vehicles_renumbered=renumbered,
        sizes_filled=filled,
    )
    return sized, time_step, report


def _rows(head: Head, bad_rows: BadRows) -> tuple[Rows, int]:
    """Returns the rows of a file and how many persons were left out already."""
    if not head.names:
        return read_fcd_xml(head.path, ATTRIBUTES, bad_rows)
    time = Column("time", TIMES, low=-LATEST, high=LATEST)
    beside = () if _is_id(head) else BESIDE
    if not _has_clock(head):
        rows = read_rows(head, (time, *ATTRIBUTES, EDGE, *beside), bad_rows=bad_rows)
        return rows, sum(rows.others.values())
    words = (replace(time, type=pl.Categorical()), *ATTRIBUTES, EDGE, *beside)
    rows = read_rows(head, words, bad_rows=bad_rows)
    return replace(rows, table=rows.table.with_columns(_seconds(rows))), sum(rows.others.values())


def _is_id(head: Head) -> bool:
    """Returns whether all ids stand in one column, named for the element that came first."""
    names = {plain(name) for name in head.names}
    return sum(any(plain(spelling) in names for spelling in (f"{tag}_id", f"timestep_{tag}_id")) for tag in TAGS) < 2


def _has_clock(head: Head) -> bool:
    """Returns whether times are hours:minutes:seconds, as SUMO writes with --human-readable-time."""
    if head.types is not None:
        return any(kind == pl.String for name, kind in head.types.items() if plain(name) in TIMES)
    _, _, rows = head.text.partition(b"\n")
    return b":" in re.split(rb"[,;\t\n]", rows, maxsplit=1)[0]


def _seconds(rows: Rows) -> pl.Series:
    moments = {}
    for text in rows.table["time"].cast(pl.String).unique():
        try:
            moments[text] = seconds(text)
        except ValueError as error:
            raise FormatError(
                f"{rows.file}: expected times as hours:minutes:seconds, found '{text[:SHOWN]}'"
            ) from error
    return rows.table["time"].cast(pl.String).replace_strict(moments, return_dtype=pl.Float64)


def _vehicles_only(table: pl.DataFrame, others: int) -> tuple[pl.DataFrame, int]:
    """Returns the vehicles with their kinds, and the number of all other rows.

    In csv and parquet persons stand among the vehicles; they have an edge, and vehicles a lane.
    """
    kind = pl.lit("car", dtype=PLANE_SCHEMA[c.KIND])
    if "type" in table.columns:
        known = {name: _kind(name) for name in table["type"].unique().drop_nulls()}
        types = pl.Series(list(known), dtype=pl.Categorical())
        kinds = pl.Series(list(known.values()), dtype=PLANE_SCHEMA[c.KIND])
        kind = pl.when(pl.col("type").is_not_null()).then(translated(table["type"], types, kinds)).otherwise(kind)
    vehicles = table.with_columns(kind.alias(c.KIND))
    vehicles = vehicles.drop_nulls(c.KIND) if vehicles[c.KIND].has_nulls() else vehicles
    if {"edge", "lane"} <= set(table.columns):
        vehicles = vehicles.filter(pl.col("edge").is_null() | pl.col("lane").is_not_null())
    return vehicles, others + table.height - vehicles.height


def _kind(type_name: str) -> str | None:
    """Returns the kind of a vehicle of that type; None of what is no motor vehicle on a road."""
    words = {word.lower() for word in WORD.findall(type_name)}
    words |= {ENDINGS.sub("", word) for word in words} | {COMPOUND for word in words if COMPOUND in word}
    return next((kind for word, kind in KINDS.items() if word in words), "car")


def _in_plane(table: pl.DataFrame, part: str, ids: pl.Series, frames: Int[np.ndarray, "row"]) -> pl.DataFrame:
    optional = {"lane": SOURCE_LANE, "speed": c.RECORDED_V, "acceleration": c.RECORDED_A}
    known: dict[str, pl.Expr | pl.Series] = {
        c.RECORDING: pl.lit(part),
        c.VEHICLE: ids,
        c.FRAME: pl.Series(frames),
        PX: pl.col("x"),
        PY: pl.col("y"),
    }
    found = {ours: pl.col(name) for name, ours in optional.items() if name in table.columns}
    return plane_rows(table, known | found)


def _check_metres(name: str, table: pl.DataFrame, frames: Int[np.ndarray, "row"], time_step: float) -> None:
    """Raises an error if the positions are longitude and latitude: they hardly change at any speed."""
    near = table.select(((pl.col("x").abs() <= 180) & (pl.col("y").abs() <= 90)).all()).item()
    if not near or "speed" not in table.columns:
        return
    order = ["id", "frame"]
    tracks = table.select("id", "x", "y", "speed", frame=pl.Series(frames)).head(CHECKED).sort(order)
    steps = tracks.with_columns(pl.col("x", "y", "frame").diff().over("id")).filter(pl.col("frame") == 1)
    moved = steps.select((pl.col("x") ** 2 + pl.col("y") ** 2).sqrt().sum()).item()
    told = steps.select(pl.col("speed").sum() * time_step).item()
    if moved < NARROW * told:
        raise FormatError(
            f"{name}: its positions are longitude and latitude (--fcd-output.geo); run SUMO without that option, or "
            "with --fcd-output.utm, so that they are in metres"
        )


SUMO = Format(
    "sumo",
    "SUMO floating car data",
    ".xml, .csv, in .gz or .zip; .parquet",
    read_sumo,
    table_of((Column("time", TIMES), *ATTRIBUTES), misses_sumo),
)
